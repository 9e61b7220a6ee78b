"""Material of pages: what may be taken for a target's picture."""

from pathlib import Path

import pytest

from hlp.reporting.page.report_data import picture_path


@pytest.mark.parametrize(
    ("name", "taken"),
    [
        ("picture.jpg", True),
        *((name, False) for name in ("../outside.jpg", "text.jpg", "link.jpg", "absent.jpg", "..")),
        ("{report}/picture.jpg", False),  # an absolute path
    ],
)
def test_only_pictures_in_the_runs_own_folder_are_taken(
    tmp_path: Path, name: str, taken: bool
) -> None:
    report = tmp_path / "run" / "report"
    report.mkdir(parents=True)
    for path in (report / "picture.jpg", tmp_path / "run" / "outside.jpg"):
        path.write_bytes(b"\xff\xd8\xff\xe0rest")
    (report / "text.jpg").write_text("of the user")
    (report / "link.jpg").symlink_to(tmp_path / "run" / "outside.jpg")
    found = picture_path(tmp_path / "run", {"picture": name.format(report=report)})
    assert found == (report / name if taken else None)
