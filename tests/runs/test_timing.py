"""A run's times are its own: those of a run before it are never reported."""

import os
import time
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from fake_detection import KEYS, OBJECTS, FakeEstimator, FakeTraining, fake_dataset, method_settings
from hlp.method.find.trace import STAGES
from hlp.results.poses_file import read_poses, write_poses
from hlp.runs.timing import measure_times
from hlp.stages import detection
from hlp.stages.detection import DetectionStages
from hlp.stages.store import StageStore

SETTINGS = method_settings()


class Slow(FakeEstimator):
    """Takes 50 ms to refine."""

    def refine(self, *given: Any) -> Any:
        time.sleep(0.05)
        return super().refine(*given)


class Fast(FakeEstimator):
    """Takes 5 ms to refine."""

    def refine(self, *given: Any) -> Any:
        time.sleep(0.005)
        return super().refine(*given)


def run_of(
    work: Path, estimator: type, monkeypatch: pytest.MonkeyPatch, timing_frames: int = 2
) -> tuple[Any, Any]:
    """A run over the three frames, with such an estimator; its stages are yet to be made."""
    monkeypatch.setattr(detection, "PoseEstimator", estimator)
    dataset: Any = fake_dataset()
    settings = SimpleNamespace(timing_frames=timing_frames)
    stages = DetectionStages(dataset, SETTINGS, FakeTraining(), StageStore(work), KEYS)  # type: ignore[arg-type]
    return SimpleNamespace(dataset=dataset, settings=settings, keys=KEYS), stages


def test_a_run_that_made_all_reports_its_own_times(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    run, stages = run_of(tmp_path, Slow, monkeypatch)
    timing = measure_times(run, stages, stages.estimates())
    asked = len(stages.estimator.asked)
    assert asked == 3 * len(OBJECTS) * (len(KEYS) + 1)  # nothing is looked at again
    own = timing.milliseconds()
    assert len(own["total"]) == len(KEYS) * len(OBJECTS)
    assert min(own["refinement"]) >= 50.0
    assert own["local"] == [250.0] * 6 and own["voting"] == [125.0] * 6
    for i, total in enumerate(own["total"]):
        steps = (own[name][i] for name in own if name != "total")
        assert total == pytest.approx(sum(steps))
    assert timing.summary() == {
        "frames": 3,
        "objects": 6,
        "reused_stages": [],
        "first_use_seconds": stages.first_use_seconds,
        "cpu_ms": pytest.approx(1000 * stages.cpu_seconds / 6),
        "wall_ms": pytest.approx(sum(own["total"]) / 6),
        "load": timing.load,
        "cores": os.cpu_count(),
    }


class Busy(FakeEstimator):
    """Computes for 50 ms of CPU time to refine."""

    def refine(self, *given: Any) -> Any:
        end = time.process_time() + 0.05
        while time.process_time() < end:
            pass
        return super().refine(*given)


@pytest.mark.parametrize("found_on_disk", [False, True])
def test_cpu_time_is_what_the_process_computed_not_what_it_waited(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, found_on_disk: bool
) -> None:
    spent = {}
    for estimator in (Slow, Busy):
        run, stages = run_of(tmp_path / estimator.__name__, estimator, monkeypatch)
        if found_on_disk:
            stages.poses()
            run, stages = run_of(tmp_path / estimator.__name__, estimator, monkeypatch)
        spent[estimator] = measure_times(run, stages, stages.estimates()).summary()
    assert spent[Busy]["cpu_ms"] >= 50.0
    assert spent[Slow]["cpu_ms"] < 50.0 <= spent[Slow]["wall_ms"]


def test_cpu_time_of_workers_is_not_known(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    run, stages = run_of(tmp_path, Fast, monkeypatch)
    estimates = stages.estimates()
    stages.cpu_seconds = 0.0  # as where others have processed all frames
    assert measure_times(run, stages, estimates).summary()["cpu_ms"] is None


def test_a_run_that_found_its_poses_on_disk_measures_anew_and_says_so(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    run, slow = run_of(tmp_path, Slow, monkeypatch)
    slow.poses()
    run, fast = run_of(tmp_path, Fast, monkeypatch)
    timing = measure_times(run, fast, fast.estimates())
    own = timing.milliseconds()
    assert len(own["total"]) == 2 * len(OBJECTS)  # of timing_frames frames
    assert max(own["refinement"]) < 50.0  # not those of the slow run
    assert timing.summary()["reused_stages"] == [*STAGES]
    assert timing.summary()["frames"] == 2
    # The frames are those spread evenly; the first is looked at once more before.
    assert run.dataset.frames.loads == [KEYS[0], KEYS[1]]
    looked_at = [key for step, key, each in fast.estimator.asked if (step, each) == ("refine", 3)]
    assert looked_at == [KEYS[0], KEYS[0], KEYS[1]]
    assert timing.first_use_seconds is not None and timing.first_use_seconds > 0.0


def test_a_run_that_reused_only_regions_measures_all_steps(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    _, slow = run_of(tmp_path, Slow, monkeypatch)
    slow.regions()
    run, fast = run_of(tmp_path, Fast, monkeypatch, timing_frames=10)
    timing = measure_times(run, fast, fast.estimates())
    assert timing.reused == ("regions",)
    assert timing.frames == len(KEYS)  # no more than there are
    assert timing.first_use_seconds == fast.first_use_seconds  # nothing is loaded twice


def test_poses_file_has_an_images_time_only_where_this_run_measured_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """BOP's time is the image's: of all objects looked for, also of those without a pose."""
    _, first = run_of(tmp_path, Slow, monkeypatch)
    estimates = first.estimates()
    write_poses(tmp_path / "first.csv", estimates)
    for each in read_poses(tmp_path / "first.csv"):
        image = (each.scene_id, each.frame_id)
        looked_for = [e for e in estimates if (e.scene_id, e.frame_id) == image]
        assert len(looked_for) == len(OBJECTS)
        expected = sum(sum(e.seconds.values()) for e in looked_for)
        assert each.seconds["total"] == pytest.approx(expected)
    _, again = run_of(tmp_path, Slow, monkeypatch)
    write_poses(tmp_path / "again.csv", again.estimates())
    rows = (tmp_path / "again.csv").read_text().splitlines()[1:]
    assert len(rows) == 5 and all(row.endswith(",-1.0") for row in rows)
