"""Material of pages: what may be taken for a target's picture."""

from pathlib import Path

import pytest

from hlp.reporting.page.report_data import picture_path

JPEG = b"\xff\xd8\xff\xe0rest"


@pytest.fixture
def run(tmp_path: Path) -> Path:
    """A run from somebody else, with a picture, a file that is none, and a link to another file."""
    report = tmp_path / "run" / "report"
    report.mkdir(parents=True)
    for path in (report / "picture.jpg", tmp_path / "run" / "outside.jpg"):
        path.write_bytes(JPEG)
    (report / "text.jpg").write_text("of the user")
    (report / "link.jpg").symlink_to(tmp_path / "run" / "outside.jpg")
    return tmp_path / "run"


def test_a_picture_of_the_run_is_taken(run: Path) -> None:
    found = picture_path(run, {"picture": "picture.jpg"})
    assert found is not None and found.read_bytes() == JPEG


@pytest.mark.parametrize(
    "name", ["../outside.jpg", "text.jpg", "link.jpg", "absent.jpg", "/etc/hostname", ".."]
)
def test_nothing_else_is(run: Path, name: str) -> None:
    assert picture_path(run, {"picture": name}) is None


def test_an_absolute_path_is_not_taken(run: Path) -> None:
    assert picture_path(run, {"picture": str(run / "report" / "picture.jpg")}) is None
