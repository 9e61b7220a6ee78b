"""Files that are written whole, JSON in general, and records of runs that are none."""

import os
from pathlib import Path

import numpy as np
import pytest

from bad_input import DEEP, Case, check, of_file, written
from hlp import files
from hlp.errors import DataError
from hlp.files import (
    read_csv,
    read_json,
    read_npz,
    replaced,
    write_array,
    write_csv,
    write_json,
    write_text,
)
from hlp.method.learn.learnt_folder import read_record
from hlp.reporting.sweeps import read_sweeps
from hlp.results.recalls import read_summary


def test_content_comes_back(tmp_path):
    write_json(tmp_path / "new" / "a.json", {"θ": [1, None, 0.1]})
    assert read_json(tmp_path / "new" / "a.json") == {"θ": [1, None, 0.1]}
    write_csv(tmp_path / "b.csv", ["name", "x"], [["a,b", 0.1], ["ü", None]])
    rows = read_csv(tmp_path / "b.csv", ["name", "x"])
    assert rows == [{"name": "a,b", "x": "0.1"}, {"name": "ü", "x": ""}]


def test_an_error_while_writing_leaves_the_old_file_and_nothing_else(tmp_path):
    path = tmp_path / "a.txt"
    write_text(path, "before")
    with pytest.raises(OSError, match="No space"), replaced(path) as stream:
        stream.write(b"half")
        stream.flush()
        assert path.read_text() == "before"
        raise OSError(28, "No space left on device")
    assert path.read_text() == "before"
    assert [path.name for path in tmp_path.iterdir()] == ["a.txt"]


def test_an_error_of_the_system_names_the_file(tmp_path):
    for names, said in (((), r"left: '.*a\.txt'"), (("other",), "left: 'other'")):
        with pytest.raises(OSError, match=said), replaced(tmp_path / "a.txt"):
            raise OSError(28, "No space left", *names)


@pytest.mark.parametrize(
    "array",
    [
        np.arange(24, dtype=np.uint16).reshape(2, 3, 4),
        np.arange(6.0).reshape(2, 3).T,
        np.zeros((0, 3), np.float32),
    ],
)
def test_arrays_are_numpys_own_files(tmp_path, array):
    write_array(tmp_path / "a.npy", array.shape, np.array_split(array, 2))
    np.testing.assert_array_equal(np.load(tmp_path / "a.npy"), array)
    np.save(tmp_path / "b.npy", np.ascontiguousarray(array))
    assert (tmp_path / "a.npy").read_bytes() == (tmp_path / "b.npy").read_bytes()


def test_arrays_on_a_full_disk_say_so(tmp_path):
    full = Path("/dev/full")
    if not full.exists():
        pytest.skip("no /dev/full")
    (tmp_path / f".a.npy.{os.getpid()}").symlink_to(full)
    with pytest.raises(OSError, match=r"No space left on device: '.*a\.npy'"):
        write_array(tmp_path / "a.npy", (100_000,), [np.zeros(100_000)])


def test_arrays_that_take_far_more_room_than_their_file_are_not_read(tmp_path, monkeypatch):
    np.savez_compressed(tmp_path / "a.npz", zeros=np.zeros(1_000_000))
    assert read_npz(tmp_path / "a.npz")["zeros"].size == 1_000_000
    monkeypatch.setattr(files, "_ROOM", 1_000_000)
    with pytest.raises(DataError, match=r"a\.npz is damaged \(it states 8000\d+ bytes"):
        read_npz(tmp_path / "a.npz")


def test_a_written_file_has_the_usual_permissions(tmp_path):
    (tmp_path / "plain").write_text("")
    write_text(tmp_path / "ours", "")
    assert os.stat(tmp_path / "ours").st_mode == os.stat(tmp_path / "plain").st_mode


def test_what_cannot_be_read_is_named(tmp_path):
    for read in (read_json, lambda path: read_csv(path, ["a"])):
        with pytest.raises(FileNotFoundError, match="gone"):
            read(tmp_path / "gone")
    (tmp_path / "a.csv").write_text("b\n1\n")
    with pytest.raises(ValueError, match=r"a\.csv: the first line must be a$"):
        read_csv(tmp_path / "a.csv", ["a"])


BROKEN_JSON = {
    "": "a.json is not JSON",
    "{": "is not JSON",
    '{"1": 1, "1": 2}': "states the key '1' twice",
    DEEP: "nested deeper than 64",
    "[" * 80 + "]" * 80: "nested deeper than 64",
}
CASES: dict[str, Case] = {
    f"json {text[:20]!r} {len(text)}": (of_file(read_json, "a.json", text), said)
    for text, said in BROKEN_JSON.items()
} | {
    "json in UTF-16": (of_file(read_json, "a.json", '{"a": 1}'.encode("utf-16")), "UTF-8"),
    "json that is a folder": (read_json, "there is no file"),
    "no json": (lambda folder: read_json(folder / "none.json"), "there is no file"),
    "large json": (
        lambda folder: read_json(written(folder / "a.json", "[" + "1," * 99 + "1]"), 100),
        "has 201 bytes: at most 100",
    ),
    "summary: empty": (of_file(read_summary, "summary.json", "{}"), "targets is missing"),
    "results: no manifest": (
        lambda folder: read_sweeps(written(folder / "summary.json", "{}").parent),
        "manifest.json",
    ),
    "sweep: no keys": (lambda folder: read_sweeps(written(folder / "sweep.json", "{}").parent), ""),
    "learnt: none": (read_record, "holds no learnt objects"),
}


@pytest.mark.parametrize("case", CASES)
def test_what_is_wrong_is_said_by_an_error_of_our_own(tmp_path, case):
    check(CASES[case], tmp_path)
