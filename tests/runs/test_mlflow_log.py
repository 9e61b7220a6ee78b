from pathlib import Path
from typing import Any

import pytest

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
