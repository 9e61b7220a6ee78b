"""A run's times are its own: those of a run before it are never reported."""

import os
import time
from types import SimpleNamespace
from typing import Any

import pytest

from fake_detection import KEYS, OBJECTS, FakeEstimator, FakeTraining, fake_dataset, method_settings
from hlp.method.find.trace import STAGES
from hlp.runs.timing import measure_times
from hlp.stages import detection
from hlp.stages.detection import DetectionStages
from hlp.stages.store import StageStore

SETTINGS = method_settings()


class Slow(FakeEstimator):
    """Waits 50 ms to refine."""

    def refine(self, *given):
        time.sleep(0.05)
        return super().refine(*given)


class Busy(FakeEstimator):
    """Computes for 50 ms of CPU time to refine."""

    def refine(self, *given):
        end = time.process_time() + 0.05
        while time.process_time() < end:
            pass
        return super().refine(*given)


@pytest.fixture
def run_of(tmp_path, monkeypatch):
    """A run over the three frames, with such an estimator; its stages are yet to be made."""

    def make(estimator, timing_frames=2, work="work"):
        monkeypatch.setattr(detection, "PoseEstimator", estimator)
        dataset: Any = fake_dataset()
        settings, store = SimpleNamespace(timing_frames=timing_frames), StageStore(tmp_path / work)
        stages = DetectionStages(dataset, SETTINGS, FakeTraining(store), KEYS)  # type: ignore[arg-type]
        return SimpleNamespace(dataset=dataset, settings=settings, keys=KEYS), stages

    return make


def test_a_run_that_made_all_reports_its_own_times(run_of):
    run, stages = run_of(Slow)
    timing = measure_times(run, stages, stages.estimates())
    asked = len(stages.estimator.asked)
    assert asked == 3 * len(OBJECTS) * (len(KEYS) + 1)  # nothing is looked at again
    own = timing.milliseconds()
    assert len(own["total"]) == len(KEYS) * len(OBJECTS)
    assert min(own["refinement"]) >= 50.0
    assert own["local"] == [250.0] * 6 and own["voting"] == [125.0] * 6
    for i, total in enumerate(own["total"]):
        assert total == pytest.approx(sum(own[name][i] for name in own if name != "total"))
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
    stages.cpu_seconds = 0.0  # as where workers have processed all frames
    assert measure_times(run, stages, stages.estimates()).summary()["cpu_ms"] is None


@pytest.mark.parametrize("found_on_disk", [False, True])
def test_cpu_time_is_what_the_process_computed_not_what_it_waited(run_of, found_on_disk):
    spent = {}
    for estimator in (Slow, Busy):
        if found_on_disk:
            run_of(FakeEstimator, work=estimator.__name__)[1].make("poses")
        run, stages = run_of(estimator, 1, estimator.__name__)
        spent[estimator] = measure_times(run, stages, stages.estimates()).summary()
    assert spent[Busy]["cpu_ms"] >= 50.0
    assert spent[Slow]["cpu_ms"] < 50.0 <= spent[Slow]["wall_ms"]


def test_a_run_that_found_its_poses_on_disk_measures_anew_and_says_so(run_of):
    run_of(Slow)[1].make("poses")
    run, fast = run_of(FakeEstimator)
    timing = measure_times(run, fast, fast.estimates())
    own = timing.milliseconds()
    assert len(own["total"]) == 2 * len(OBJECTS)  # of timing_frames frames
    assert max(own["refinement"]) < 50.0  # not those of the slow run
    summary = timing.summary()
    assert (summary["reused_stages"], summary["frames"]) == ([*STAGES], 2)
    # The frames are those spread evenly; the first is looked at once more before.
    assert run.dataset.frames.loads == [KEYS[0], KEYS[1]]
    asked = [key for step, key, item in fast.estimator.asked if (step, item) == ("refine", 3)]
    assert asked == [KEYS[0], KEYS[0], KEYS[1]]
    assert timing.first_use_seconds is not None and timing.first_use_seconds > 0.0


def test_a_run_that_reused_only_regions_measures_all_steps(run_of):
    run_of(FakeEstimator)[1].make("regions")
    run, fast = run_of(FakeEstimator, timing_frames=10)
    timing = measure_times(run, fast, fast.estimates())
    assert timing.reused == ("regions",)
    assert timing.frames == len(KEYS)  # no more than there are
    assert timing.first_use_seconds == fast.first_use_seconds  # nothing is loaded twice
