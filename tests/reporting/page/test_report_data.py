"""Material of pages: what may be taken for a target's picture."""

from pathlib import Path

import pytest

from hlp.errors import DataError
from hlp.reporting.page.report_data import picture_path


@pytest.mark.parametrize("name", ["../outside.jpg", "..", "{report}/picture.jpg"])
def test_a_picture_outside_of_the_runs_own_folder_is_named(tmp_path: Path, name: str) -> None:
    given = {"picture": name.format(report=tmp_path / "report")}
    with pytest.raises(DataError, match="names a file outside"):
        picture_path(tmp_path, given)


def test_only_pictures_are_taken(tmp_path: Path) -> None:
    (tmp_path / "report").mkdir()
    for name, content in (("picture.jpg", b"\xff\xd8\xff\xe0rest"), ("text.jpg", b"of the user")):
        (tmp_path / "report" / name).write_bytes(content)
    found = [picture_path(tmp_path, {"picture": f"{n}.jpg"}) for n in ("picture", "text", "absent")]
    assert found == [tmp_path / "report" / "picture.jpg", None, None]
