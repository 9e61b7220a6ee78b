"""Whole data sets from a local server: folders that HLP's readers take."""

import hashlib
import io
import json
import tarfile
import zipfile
from dataclasses import replace
from pathlib import Path

import pytest
from filelock import FileLock

import http_file_server
from bop_folder import write_models, write_scene, write_targets
from hlp.cli import main
from hlp.data.bop import BopSettings
from hlp.data.photographs import list_photographs
from hlp.data.public.download import SOURCES, download
from hlp.data.public.sets import SETS, find_set
from hlp.errors import DataError, InputError, NetworkError
from http_file_server import Served

PATH = "lm/resolve/main"


def zipped(root: Path, around: str = "", skip: str = "") -> bytes:
    content = io.BytesIO()
    with zipfile.ZipFile(content, "w") as packed:
        for path in sorted(each for each in root.rglob("*") if each.is_file()):
            name = path.relative_to(root).as_posix()
            if not skip or not name.startswith(skip):
                packed.write(path, around + name)
    return content.getvalue()


@pytest.fixture
def server(tmp_path):
    """BOP's three archives of `lm`, of a small data set."""
    base, models, test = (tmp_path / name for name in ("base", "models", "test"))
    base.mkdir()
    write_targets(base / "test_targets_bop19.json", [(6, 0, 1, 1), (6, 0, 6, 2)])
    write_models(models / "models", (1, 6))
    write_scene(test / "test")
    files = {
        f"{PATH}/lm_base.zip": zipped(base, "lm/"),
        f"{PATH}/lm_models.zip": zipped(models),
        f"{PATH}/lm_test_bop19.zip": zipped(test),
        f"{PATH}/lm_test_all.zip": zipped(test, skip="test/000006/mask"),
    }
    with http_file_server.serving(Served(files, hub=True)) as served:
        yield served


def test_the_result_is_a_bop_set(server, tmp_path, capsys):
    folder = tmp_path / "sets" / "lm"
    main(["download", "lm", f"output={folder}", f"mirror={server.address}/"])
    said = capsys.readouterr().out
    assert said.index("licence") < said.index("lm_base.zip") < said.index("Next:")
    assert f"Next: hlp run data=bop data.root={folder}" in said
    frames = BopSettings(root=str(folder)).build().frames
    assert frames.keys == ("000006_000000",)
    assert [each.object_id for each in frames.load(frames.keys[0]).targets] == [1, 6, 6]
    sources = json.loads((folder / SOURCES).read_text())
    assert {each["url"].rpartition("/")[2]: each["sha256"] for each in sources["archives"]} == {
        name: hashlib.sha256(server.files[f"{PATH}/{name}"]).hexdigest()
        for name in ("lm_base.zip", "lm_models.zip", "lm_test_bop19.zip")
    }
    assert [each.name for each in folder.parent.iterdir()] == ["lm"]


def test_a_call_after_an_interruption_continues(server, tmp_path):
    server.statuses = [200, 200, 200, 200, 404]
    folder = tmp_path / "lm"
    with pytest.raises(NetworkError, match="404"):
        download(find_set("lm"), folder, "bop19", server.address, waits=())
    assert not folder.exists()
    download(find_set("lm"), folder, "bop19", server.address, waits=())
    assert [name for name, _ in server.asked] == [
        "lm_base.zip", "lm_models.zip", "lm_test_bop19.zip",
    ]  # fmt: skip
    with pytest.raises(InputError, match="is there already"):
        download(find_set("lm"), folder, "bop19", server.address, waits=())


def test_a_damaged_or_hostile_archive_leaves_no_folder(server, tmp_path):
    content = io.BytesIO()
    with zipfile.ZipFile(content, "w") as packed:
        packed.writestr("../../out.txt", "out")
    server.files[f"{PATH}/lm_models.zip"] = content.getvalue()
    with pytest.raises(DataError, match=r"lm_models\.zip: its member .* leads out"):
        download(find_set("lm"), tmp_path / "lm", "bop19", server.address, waits=())
    assert not (tmp_path / "lm").exists() and not list(tmp_path.rglob("out.txt"))


def test_another_process_that_loads_the_same_is_said(server, tmp_path):
    held = FileLock(tmp_path / ".lm.lock")
    with held, pytest.raises(InputError, match="another process"):
        download(find_set("lm"), tmp_path / "lm", "all", server.address, waits=())


def test_voc_becomes_a_folder_of_photographs(tmp_path):
    content = io.BytesIO()
    with tarfile.open(fileobj=content, mode="w") as tape:
        for kind in ("JPEGImages/1.jpg", "SegmentationClass/1.png"):
            info = tarfile.TarInfo(f"VOCdevkit/VOC2012/{kind}")
            info.size = 4
            tape.addfile(info, io.BytesIO(b"1234"))
    files = {"VOCtrainval_11-May-2012.tar": content.getvalue()}
    with http_file_server.serving(Served(files)) as served:
        with pytest.raises(DataError, match="its md5 is"):  # it is not the true one
            download(find_set("voc2012"), tmp_path / "voc", "all", served.address, waits=())
        unknown = replace(find_set("voc2012"), known={})
        download(unknown, tmp_path / "voc", "all", served.address, waits=())
    photographs = list_photographs(tmp_path / "voc" / "VOCdevkit" / "VOC2012" / "JPEGImages")
    assert [each.name for each in photographs] == ["1.jpg"]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["nothing"], "there is no data set 'nothing': choose from lm, lmo"),
        (["images=all", "lm"], "the name of a data set comes first"),
        (["lm", "images=few"], "images=few: lm has bop19, all"),
        (["voc2012", "images=bop19"], "images=bop19: voc2012 has all"),
        (["lm", "folder=x"], "folder is no key of `hlp download`"),
    ],
)
def test_wrong_arguments_are_one_line(arguments, message, capsys):
    with pytest.raises(SystemExit) as stopped:
        main(["download", *arguments])
    assert stopped.value.code == 1
    assert message in capsys.readouterr().err


def test_help_lists_all_sets_and_every_archive_has_an_address(capsys):
    main(["download", "--help"])
    shown = capsys.readouterr().out
    for public in SETS.values():
        assert public.what in shown
        for images in public.archives:
            for archive in public.files(images):
                assert archive.url.startswith(("https://huggingface.co/datasets/", "http://host."))
                kind, _, digits = (archive.checksum or "md5:" + "0" * 32).partition(":")
                assert len(digits) == {"md5": 32, "sha256": 64}[kind]
