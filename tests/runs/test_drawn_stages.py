from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from hlp.records import Target, TargetScore
from hlp.runs import stage_pictures
from hlp.runs.stage_pictures import draw_stages


def broken(panels: int) -> Any:
    """A run whose data set is missing."""
    return SimpleNamespace(settings=SimpleNamespace(panels=panels), dataset=None, keys=())


def test_what_goes_wrong_is_logged_and_costs_nothing(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    nothing: Any = None
    draw_stages(broken(2), nothing, [], [], tmp_path)
    assert f"a picture in {tmp_path / 'stages'} could not be made" in caplog.text
    assert "Traceback" in caplog.text


def test_a_picture_that_fails_costs_the_others_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(_: Any) -> None:
        raise ValueError("no windows")

    monkeypatch.setattr(stage_pictures, "sample_windows", fail)
    monkeypatch.setattr(
        stage_pictures, "draw_view_sheet", lambda _: np.zeros((4, 4, 3), dtype=np.uint8)
    )
    training: Any = SimpleNamespace(classes=[], models={})
    draw_stages(broken(2), SimpleNamespace(training=training), [], [], tmp_path)  # type: ignore[arg-type]
    assert [each.name for each in (tmp_path / "stages").iterdir()] == ["views.jpg"]


def test_nothing_is_drawn_without_panels(tmp_path: Path) -> None:
    nothing: Any = None
    draw_stages(broken(0), nothing, [], [], tmp_path)
    assert list(tmp_path.iterdir()) == []


def score(frame: int, object_id: int, right: bool, found: bool = True, cause: str = "") -> Any:
    verdicts = (right, right, right)
    errors = (0.0, 0.0, 0.0, 1.0)
    return TargetScore(1, frame, object_id, found, 1.0, *errors, *verdicts, cause=cause)


def test_swarms_are_drawn_of_the_frames_in_turn_and_of_missed_targets(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    drawn: dict[str, list[tuple[str, int, str]]] = {}

    read_keys: list[str] = []

    def read(_: Any, key: str, __: Any) -> Any:
        read_keys.append(key)
        targets = tuple(Target(each, np.eye(4)) for each in (4, 2))
        return SimpleNamespace(frame=SimpleNamespace(key=key, targets=targets))

    monkeypatch.setattr(stage_pictures, "FoundInFrame", SimpleNamespace(read=read))
    monkeypatch.setattr(
        stage_pictures,
        "swarms_of_target",
        lambda _, found, target, verdict: (found.frame.key, target.object_id, verdict),
    )
    monkeypatch.setattr(stage_pictures, "swarm_figure", lambda targets: targets)
    monkeypatch.setattr(
        stage_pictures, "save_jpeg", lambda figure, path: drawn.update({path.stem: figure})
    )
    keys = tuple(f"000001_00000{frame}" for frame in range(4))
    run: Any = SimpleNamespace(settings=SimpleNamespace(panels=4), keys=keys, dataset=None)
    detection: Any = SimpleNamespace(training=None, failed={keys[1]: "no depth"})
    scores = [
        *(score(0, 4, True), score(0, 2, False, found=False, cause="few_votes")),
        *(score(1, 4, False), score(1, 2, False)),  # of the frame that failed
        *(score(2, 4, True), score(2, 2, True)),
        *(score(3, 4, True), score(3, 2, False)),
    ]
    draw_stages(run, detection, [], scores, tmp_path)
    assert drawn == {
        "swarm_costs": [
            (keys[0], 4, "right"),
            (keys[2], 4, "right"),
            (keys[3], 2, "wrong"),
        ],
        "missed_swarm_costs": [(keys[0], 2, "not found (few votes)"), (keys[3], 2, "wrong")],
    }
    assert sorted(read_keys) == sorted({keys[0], keys[2], keys[3]})  # each once
