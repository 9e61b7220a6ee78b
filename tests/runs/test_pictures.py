"""Which pictures are drawn of a run, and that none costs it anything."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from matplotlib.figure import Figure

from box_scene import at
from hlp.method.find.trace import ObjectTrace
from hlp.records import Frame, Hypotheses, PoseEstimate, Target, TargetScore
from hlp.refinement.choice import RefinedHypotheses
from hlp.refinement.refiner import Refinement
from hlp.runs import pictures
from hlp.runs.pictures import MISSED, RIGHT, draw_pictures, page_targets
from hlp.runs.stage_samples import FrameResults

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
    monkeypatch.setattr(pictures.stage_figures, "view_sheet", lambda _: Figure())
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

    of_page = {"report": "report_data.ReportData", "stages": "report_data.CAPTIONS"}
    monkeypatch.setattr(f"hlp.runs.pictures.{of_page.get(folder, 'spread')}", fail)
    draw(tmp_path, panels)
    words = "the report" if folder == "report" else str(tmp_path / folder)
    assert any(words in line and "could not be made" in line for line in caplog.messages)


def score(frame: int, object_id: int, right: bool, found: bool = True, cause: str = "") -> Any:
    verdicts = (right, right, right)
    errors = (0.0, 0.0, 0.0, 1.0)
    return TargetScore(1, frame, object_id, found, 1.0, *errors, *verdicts, cause=cause)


def test_swarms_are_drawn_of_the_targets_of_the_frames_in_turn(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    drawn: dict[str, list[tuple[str, int, str]]] = {}
    read_keys: list[str] = []

    def read(_: Any, __: Any, key: str) -> Any:
        read_keys.append(key)
        targets = tuple(Target(object_id, np.eye(4)) for object_id in (4, 2))
        frame = Frame(1, int(key[-1]), IMAGE, DEPTH, np.eye(3), targets)
        traced = SimpleNamespace(region=(), votes=(), hypotheses=None, refined=None)
        return FrameResults(frame, {4: traced, 2: traced}, ())  # type: ignore[dict-item]

    def swarms(_: Any, found: Any, seen: Any) -> tuple[str, int, str]:
        return found.frame.key, seen.truth.object_id, seen.verdict

    monkeypatch.setattr(pictures, "FrameResults", SimpleNamespace(read=read))
    monkeypatch.setattr(pictures, "swarms_of_target", swarms)
    monkeypatch.setattr(pictures.stage_figures, "swarm_figure", lambda targets: targets)
    monkeypatch.setattr(
        pictures, "save_jpeg", lambda figure, path: drawn.update({path.stem: figure})
    )
    keys = tuple(f"000001_00000{frame}" for frame in range(4))
    scores = [
        *(score(0, 4, True), score(0, 2, False, found=False, cause="few_votes")),
        *(score(1, 4, False), score(1, 2, False)),  # of the frame that failed
        *(score(2, 4, False, cause="few_votes"), score(2, 2, True)),
        *(score(3, 4, True), score(3, 2, False)),
    ]
    dataset = SimpleNamespace(models={4: None, 2: None}, target_ids=())
    draw(tmp_path, 4, keys, failed={keys[1]: "no depth"}, scores=scores, dataset=dataset)
    assert drawn["swarm_costs"] == [
        (keys[0], 4, "right"), (keys[2], 4, "wrong, few votes"), (keys[3], 2, "wrong"),
    ]  # fmt: skip
    assert sorted(read_keys) == sorted({keys[0], keys[2], keys[3]})  # each once


IMAGE, DEPTH = np.zeros((4, 4, 3), np.uint8), np.zeros((4, 4))


def answer(object_id: int, pose: np.ndarray | None) -> PoseEstimate:
    return PoseEstimate(1, 3, object_id, pose, 0.5)


def found(*estimates: PoseEstimate, **poses: list[float]) -> FrameResults:
    """Object 6 with coarse poses 1 and 2 m away; the fine ones and where they began as given."""
    trace = ObjectTrace(hypotheses=Hypotheses(np.stack([at(0, 0, 1.0), at(0, 0, 2.0)]), np.ones(2)))
    if poses:
        fine = [Refinement(at(0, 0, z), 0) for z in poses["fine"]]
        starts, count = np.stack([at(0, 0, z) for z in poses["starts"]]), len(fine)
        of_region = np.arange(count)
        refined = RefinedHypotheses(fine, np.zeros(count), of_region, starts, (0,))
        trace = replace(trace, refined=refined)
    return FrameResults(Frame(1, 3, IMAGE, DEPTH, np.eye(3)), {6: trace}, estimates)


def test_the_answer_for_a_target_is_the_nearest_of_its_object() -> None:
    target, near = Target(6, at(0, 0, 1.0)), answer(6, at(0, 0, 1.2))
    assert found(answer(6, at(0, 0, 2.0)), answer(2, at(0, 0, 1.0)), near).nearest(target) is near
    assert found(answer(6, None)).nearest(target) is None


@pytest.mark.parametrize(("fine", "coarse"), [(1.9, 2.0), (0.9, 1.0), (3.0, 3.3)])
def test_the_coarse_pose_is_the_one_that_was_refined(fine: float, coarse: float) -> None:
    seen = found(fine=[0.9, 1.9, 3.0], starts=[1.0, 2.0, 3.3]).coarse(6, answer(6, at(0, 0, fine)))
    assert seen is not None and seen[2, 3] == coarse


def test_without_an_answer_the_best_coarse_pose_is_shown() -> None:
    seen = found().coarse(6, None)
    assert seen is not None and seen[2, 3] == 1.0


def test_targets_are_scored_object_by_object() -> None:
    targets = tuple(Target(i, at(0, 0, z)) for i, z in [(6, 1.0), (2, 1.0), (6, 2.0)])
    results = FrameResults(Frame(1, 3, IMAGE, DEPTH, np.eye(3), targets), {}, ())
    ordered = [(target.object_id, target.pose_cam_obj[2, 3]) for target in results.targets]
    assert ordered == [(6, 1.0), (6, 2.0), (2, 1.0)]


def test_missed_targets_and_some_right_ones_are_on_the_page() -> None:
    scored = {
        "three": [score(3, 6, True), score(3, 2, False), score(3, 6, False)],
        "four": [score(4, 6, True)],
    }
    assert page_targets(scored) == [
        ((1, 3, 2, 0), "three", 1),
        ((1, 3, 6, 0), "three", 0),
        ((1, 3, 6, 1), "three", 2),
        ((1, 4, 6, 0), "four", 0),
    ]


def test_too_many_are_thinned_out_evenly() -> None:
    scored = {str(frame): [score(frame, 1, frame % 2 == 0)] for frame in range(4 * MISSED)}
    chosen = [key[1] for key, *_ in page_targets(scored)]
    missed, right = ([f for f in chosen if f % 2 == odd] for odd in (1, 0))
    assert (len(missed), len(right)) == (MISSED, RIGHT)
    assert max(np.diff(missed)) <= 4 and missed[0] < 10 and missed[-1] > 4 * MISSED - 10
