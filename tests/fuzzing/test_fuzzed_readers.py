"""Whatever stands in a file from outside: a sound result, or an error that names the file."""

import io
import json
import tarfile
import zipfile

import numpy as np
import pytest
from readers import MODELS, OBJ, read_mesh, readers, try_content, try_seed
from spoiled_files import is_clean

from hlp.data.images import read_raw_depth
from hlp.errors import DataError
from hlp.method.learn.model_files import read_history
from hlp.objects.meshes import load_mesh

READERS = (
    *("bop", "intrinsics", "numbers", "images", "archives", "lines", "report", "arguments"),
    *("meshes", "poses.csv", "scores.csv", "learnt.json", "runs"),
)
KEPT: dict[str, tuple[int, ...]] = {"runs": (642230255428,)}
"""Seeds that broke a reader once."""


@pytest.mark.parametrize("name", READERS)
def test_spoiled_files(tmp_path, name):
    (tmp_path / "valid").mkdir()
    cases = readers(tmp_path / "valid")[name]
    for number, each in enumerate(cases):
        folder = tmp_path / f"sound{number}"
        folder.mkdir()
        assert try_content(each, each.content, folder)
    for seed in (*KEPT.get(name, ()), *range(20 * len(cases))):
        folder = tmp_path / str(seed)
        folder.mkdir()
        try_seed(cases, seed, folder)


def test_every_reader_is_tried(tmp_path):
    assert {*readers(tmp_path)} == {*READERS}


def nameless_zip():
    """A ZIP archive with a file without a name."""
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w") as archive:
        archive.writestr(zipfile.ZipInfo(""), b"content")
    return stream.getvalue()


def endless_tar():
    """A tar archive whose first name is said to be longer than any memory."""
    about = tarfile.TarInfo("name")
    about.type, about.size = tarfile.GNUTYPE_LONGNAME, 2**60
    return about.tobuf(tarfile.GNU_FORMAT) + bytes(512)


@pytest.mark.parametrize(
    ("name", "file", "content"),
    [
        ("bop", "models_info.json",
         json.dumps(MODELS).replace('"axis": [0,', '"axis": [1e+300,').encode()),
        ("runs", ".hydra/overrides.yaml", b"*a"),
        ("runs", ".hydra/overrides.yaml", b"seed"),
        ("runs", ".hydra/overrides.yaml", b"- 1"),
        ("archives", "a.zip", nameless_zip()),
        ("archives", "a.tar", endless_tar()),
        ("arguments", "box.txt", b"~a\0b["),
    ],
)  # fmt: skip
def test_what_broke_a_reader_once(tmp_path, name, file, content):
    valid, tried = tmp_path / "valid", tmp_path / "tried"
    valid.mkdir()
    tried.mkdir()
    (chosen,) = (each for each in readers(valid)[name] if each.name == file)
    try_content(chosen, content, tried)


@pytest.mark.parametrize(
    ("rows", "columns", "length"), [(65536, 65536, 0), (-3, -4, 24), (3, 4, 23), (0, 0, 0)]
)
def test_sizes_that_a_dpt_states(tmp_path, rows, columns, length):
    path = tmp_path / "depth0.dpt"
    path.write_bytes(np.array([rows, columns], "<i4").tobytes() + b"\1" * length)
    with pytest.raises(DataError, match=r"depth0\.dpt is truncated"):
        read_raw_depth(path)


def test_vertices_without_three_coordinates(tmp_path):
    (tmp_path / "box.obj").write_text("v 1\nv 0 0 1\nv 0 1 0\nf 1 2 3\n")
    with pytest.raises(DataError, match="without three coordinates"):
        load_mesh(tmp_path / "box.obj", None)


@pytest.mark.parametrize("name", ["1" + "0" * 400, "a\0b"])
def test_a_material_s_name_that_no_file_can_have(tmp_path, name):
    path = tmp_path / "box.obj"
    path.write_text(OBJ.replace("box.mtl", name))
    assert is_clean(lambda: read_mesh(path), path.name)


@pytest.mark.parametrize("content", ["epoch,loss\n0,x\n", "epoch,loss\n0\n"])
def test_a_damaged_history_is_named(tmp_path, content):
    (tmp_path / "history.csv").write_text(content)
    with pytest.raises(DataError, match=r"history\.csv, line 2"):
        read_history(tmp_path)
