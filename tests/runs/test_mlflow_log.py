from pathlib import Path
from typing import Any
from unittest.mock import MagicMock

import pytest

from hlp.errors import DataError
from hlp.runs import mlflow_log
from hlp.runs.mlflow_log import log_pictures


def test_panels_are_logged_by_frame_and_pictures_of_stages_by_name(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    logged: list[tuple[str, str, int]] = []

    class Tracker:
        def log_image(self, picture: Path, key: str, step: int) -> None:
            logged.append((picture.name, key, step))

    monkeypatch.setattr(mlflow_log, "read_targets", lambda _: {})
    panels = ("000002_000014_cat.jpg", "000002_000014_poses.jpg")
    for file in (*(f"panels/{panel}" for panel in panels), "stages/swarm_costs.jpg"):
        (tmp_path / file).parent.mkdir(exist_ok=True)
        (tmp_path / file).write_bytes(b"")
    tracker: Any = Tracker()
    log_pictures(tmp_path, tracker)
    assert logged == [
        (panels[0], "1. Pictures/panels in scene 2", 14),
        (panels[1], "1. Pictures/poses in scene 2", 14),
        ("swarm_costs.jpg", "1. Pictures/stages - swarm costs", 0),
    ]


def test_what_a_killed_run_left_is_removed_before_mlflow_gets_it_and_a_link_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    opened = MagicMock(side_effect=ZeroDivisionError)
    monkeypatch.setattr(mlflow_log, "track_run", opened)
    for name in ("short_name", "run_tags", "experiment_tags"):
        monkeypatch.setattr(mlflow_log, name, lambda *_: {})
    run = MagicMock()
    run.settings.machine.threads = 1
    (tmp_path / "panels").mkdir()
    for left in (tmp_path / ".poses.csv.123", tmp_path / "panels" / ".a.jpg.77"):
        left.touch()
    with pytest.raises(ZeroDivisionError), mlflow_log.begun(run, tmp_path):
        pass
    assert [path.name for path in tmp_path.rglob("*")] == ["panels"]
    (tmp_path / "panels" / "a.jpg").symlink_to("/etc/passwd")
    with pytest.raises(DataError, match="leads out of"), mlflow_log.begun(run, tmp_path):
        pass
