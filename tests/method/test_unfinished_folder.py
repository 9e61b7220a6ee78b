from pathlib import Path

import pytest

from hlp.method.unfinished_folder import SCORED, once

NAMES = ("codebook.npz", "sub/weights", ".done.json")


def make(folder: Path, marker: str = ".done.json") -> bool:
    """Make the content unless it is there; whether it was made."""
    with once(folder, marker) as missing:
        if missing:
            (folder / "sub").mkdir(exist_ok=True)
            (folder / "codebook.npz").write_bytes(b"features")
            (folder / "sub" / "weights").write_bytes(b"numbers")
    return missing


def test_content_is_made_once(tmp_path: Path) -> None:
    assert make(tmp_path / "object")
    assert not make(tmp_path / "object")
    assert make(tmp_path / "object", SCORED)


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("content", [b"", b"numbres", b"[" * 100_000, None])
def test_damaged_content_is_made_again(tmp_path: Path, name: str, content: bytes | None) -> None:
    make(tmp_path / "object")
    path = tmp_path / "object" / name
    if content is None:
        path.unlink()
    else:
        path.write_bytes(content)
    assert make(tmp_path / "object")
    assert (tmp_path / "object" / "sub" / "weights").read_bytes() == b"numbers"
    assert not make(tmp_path / "object")


def test_an_error_marks_nothing_as_made(tmp_path: Path) -> None:
    with pytest.raises(ZeroDivisionError), once(tmp_path / "object"):
        (tmp_path / "object" / "codebook.npz").write_bytes(b"half")
        raise ZeroDivisionError
    assert make(tmp_path / "object")
