import numpy as np
import pytest

from hlp.errors import DataError
from hlp.stages.frame_files import read_arrays, write_arrays

ARRAYS = {"6/poses": np.arange(32.0).reshape(2, 4, 4), "6/mask": np.arange(9, dtype=np.uint8)}


def test_arrays_come_back_as_they_were(tmp_path):
    write_arrays(tmp_path, "000006_000012", ARRAYS)
    found = read_arrays(tmp_path, "000006_000012")
    assert found.keys() == ARRAYS.keys()
    for name, array in ARRAYS.items():
        np.testing.assert_array_equal(found[name], array)
        assert found[name].dtype == array.dtype
    assert [path.name for path in tmp_path.iterdir()] == ["000006_000012.npz"]


def test_a_frame_without_anything_is_a_file_too(tmp_path):
    write_arrays(tmp_path, "000001_000001", {})
    assert read_arrays(tmp_path, "000001_000001") == {}


@pytest.mark.parametrize("kept", [0, 3, 100, -200, -10])
def test_a_truncated_file_is_named(tmp_path, kept):
    write_arrays(tmp_path, "key", ARRAYS)
    path = tmp_path / "key.npz"
    path.write_bytes(path.read_bytes()[:kept])
    with pytest.raises(DataError, match=r"key\.npz is damaged.*delete its folder"):
        read_arrays(tmp_path, "key")


def test_flipped_bits_are_noticed(tmp_path):
    write_arrays(tmp_path, "key", ARRAYS)
    path = tmp_path / "key.npz"
    content = bytearray(path.read_bytes())
    content[len(content) // 3] ^= 0xFF
    path.write_bytes(content)
    with pytest.raises(DataError, match=r"key\.npz is damaged"):
        read_arrays(tmp_path, "key")


def test_a_file_that_is_not_there_is_no_damage(tmp_path):
    with pytest.raises(FileNotFoundError, match=r"key\.npz"):
        read_arrays(tmp_path, "key")


def test_an_error_while_writing_leaves_the_old_file(tmp_path, monkeypatch):
    write_arrays(tmp_path, "key", ARRAYS)

    def fail(stream, **arrays):
        stream.write(b"half")
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(np, "savez_compressed", fail)
    with pytest.raises(OSError, match="No space"):
        write_arrays(tmp_path, "key", {"6/poses": np.zeros(3)})
    monkeypatch.undo()
    np.testing.assert_array_equal(read_arrays(tmp_path, "key")["6/poses"], ARRAYS["6/poses"])
