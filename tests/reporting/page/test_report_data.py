"""Material of pages: what may be taken for a target's picture."""

from pathlib import Path

import pytest

from hlp.errors import DataError
from hlp.reporting.page.report_data import Scene, picture_path


def named(picture: str) -> Scene:
    return Scene((1, 2, 3, 0), picture, [0.0] * 3, "", "", [0.0] * 16, None)


@pytest.mark.parametrize("name", ["../outside.jpg", "..", "{report}/picture.jpg"])
def test_a_picture_outside_of_the_runs_own_folder_is_named(tmp_path: Path, name: str) -> None:
    with pytest.raises(DataError, match="names a file outside"):
        picture_path(tmp_path, named(name.format(report=tmp_path / "report")))


def test_only_pictures_are_taken(tmp_path: Path) -> None:
    (tmp_path / "report").mkdir()
    for name, content in (("picture.jpg", b"\xff\xd8\xff\xe0rest"), ("text.jpg", b"of the user")):
        (tmp_path / "report" / name).write_bytes(content)
    found = [picture_path(tmp_path, named(f"{n}.jpg")) for n in ("picture", "text", "absent")]
    assert found == [tmp_path / "report" / "picture.jpg", None, None]
