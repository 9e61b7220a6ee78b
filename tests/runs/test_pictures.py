"""Which pictures are drawn of a run, and that none costs it anything."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from hlp.records import Target, TargetScore
from hlp.runs import pictures
from hlp.runs.pictures import draw_pictures

TRAINING = SimpleNamespace(classes=[], models={}, settings=SimpleNamespace(encoder=None))


def draw(folder: Path, panels: int, keys: tuple[str, ...] = (), **given: Any) -> None:
    """Of a run without views and windows; without frames unless there are keys."""
    dataset = SimpleNamespace(models={}, target_ids=())
    run: Any = SimpleNamespace(settings=SimpleNamespace(panels=panels), keys=keys, dataset=dataset)
    values = {"training": TRAINING, "dataset": dataset, "failed": {}, **given}
    scores = values.pop("scores", [])
    draw_pictures(run, SimpleNamespace(**values), [], scores, folder)  # type: ignore[arg-type]


def test_a_picture_that_fails_is_logged_and_costs_the_others_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    white = np.zeros((4, 4, 3), dtype=np.uint8)
    monkeypatch.setattr(pictures, "draw_view_sheet", lambda _: white)
    (tmp_path / "stages").mkdir()
    (tmp_path / "stages" / "old.jpg").write_bytes(b"of another run")
    draw(tmp_path, 2)
    assert [path.name for path in (tmp_path / "stages").iterdir()] == ["views.jpg"]
    assert caplog.messages == [f"a picture in {tmp_path / 'stages'} could not be made"] * 2
    assert "Traceback" in caplog.text and (tmp_path / "report" / "index.json").is_file()


def test_nothing_is_drawn_without_panels_but_the_objects_of_the_page(tmp_path: Path) -> None:
    draw(tmp_path, 0)
    assert [str(path.relative_to(tmp_path)) for path in tmp_path.rglob("*.*")] == [
        "report/index.json"
    ]


@pytest.mark.parametrize(("folder", "panels"), [("report", 0), ("panels", 2), ("stages", 2)])
def test_a_folder_that_cannot_be_cleared_or_filled_is_logged(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture,
    folder: str, panels: int,
) -> None:  # fmt: skip
    def fail(*_: Any) -> None:
        raise OSError("read-only")

    names = {"report": "ReportDataWriter", "panels": "sampled_keys", "stages": "CAPTIONS"}
    monkeypatch.setattr(pictures, names[folder], fail)
    draw(tmp_path, panels)
    words = "the report" if folder == "report" else str(tmp_path / folder)
    assert any(words in line and "could not be made" in line for line in caplog.messages)


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
        targets = [Target(object_id, np.eye(4)) for object_id in (4, 2)]
        return SimpleNamespace(frame=SimpleNamespace(key=key), targets=targets)

    def swarms(_: Any, found: Any, target: Target, verdict: str) -> tuple[str, int, str]:
        return found.frame.key, target.object_id, verdict

    monkeypatch.setattr(pictures, "FrameResults", SimpleNamespace(read=read))
    monkeypatch.setattr(pictures, "swarms_of_target", swarms)
    monkeypatch.setattr(pictures, "swarm_figure", lambda targets: targets)
    monkeypatch.setattr(
        pictures, "save_jpeg", lambda figure, path: drawn.update({path.stem: figure})
    )
    keys = tuple(f"000001_00000{frame}" for frame in range(4))
    scores = [
        *(score(0, 4, True), score(0, 2, False, found=False, cause="few_votes")),
        *(score(1, 4, False), score(1, 2, False)),  # of the frame that failed
        *(score(2, 4, True), score(2, 2, True)),
        *(score(3, 4, True), score(3, 2, False)),
    ]
    draw(tmp_path, 4, keys, failed={keys[1]: "no depth"}, scores=scores)
    assert drawn == {
        "swarm_costs": [(keys[0], 4, "right"), (keys[2], 4, "right"), (keys[3], 2, "wrong")],
        "missed_swarm_costs": [(keys[0], 2, "not found (few votes)"), (keys[3], 2, "wrong")],
    }
    assert sorted(read_keys) == sorted({keys[0], keys[2], keys[3]})  # each once
