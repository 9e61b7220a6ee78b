"""`hlp bench` on the tiny run's dataset and stages."""

import pytest

from hlp.method.find.estimator import PoseEstimator
from hlp.method.find.search import search_frame
from hlp.method.find.trace import nobody
from hlp.method.settings import FindSettings
from hlp.results.recalls import read_target_values
from hlp.stages.store import StageStore
from hlp.stages.training import TrainingStages
from hlp.studies.bench_times import PARTS, PartClock
from run_files import assert_targets_have_the_means_of_the_study, read_json
from table_text import unpadded

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("threads")]

COMPARED = ("+task.compared.few.refinement.particles=3", "+task.compared.same.seed=0")


@pytest.fixture(scope="module")
def bench(tiny_run, tmp_path_factory):
    output = tmp_path_factory.mktemp("bench")
    fast = ("patches.region.scan=fast", "refinement.iterations=4")
    run = tiny_run.build("task=bench", *fast, *COMPARED)
    run.settings.task.run(run, output)
    return output


def estimator_of(tiny_run, *overrides):
    """The run, and an estimator with what it has learnt."""
    run = tiny_run.build("task=bench", *overrides)
    training = TrainingStages(
        run.dataset, run.settings.method, StageStore(tiny_run.folder / "work")
    )
    training.make_for(run.dataset.target_ids)
    find = FindSettings.of(run.settings.method)
    return run, PoseEstimator(training, find, run.dataset.target_ids)


def test_bench_states_every_part_of_every_path(bench):
    result = read_json(bench / "bench.json")
    assert set(result["paths"]) == {"configured", "reference", "few", "same"}
    for path in result["paths"].values():
        for view in ("first", "further", "frame"):
            spreads = path[view]
            assert set(PARTS) | {"stage 1", "stage 2", "stage 3", "total"} == set(spreads)
            assert spreads["network" if view == "first" else "refine"]["median_ms"] > 0
            assert all(spread["median_ms"] <= spread["p95_ms"] for spread in spreads.values())
            assert spreads["total"]["cpu_ms"] > 0
    workload, loading = result["workload"], result["loading_s"]
    assert (workload["frames"], workload["image"], workload["particles"]) == (2, "320 x 240", 25)
    assert workload["objects"] == len(loading["objects"]) == 8
    assert 0 < loading["classifier"] < 5
    assert result["memory"]["peak_mib"] > 100
    stages = read_json(bench / "manifest.json")["stages"]
    assert stages and all(event["reused"] for event in stages)


def test_verdicts_by_target_have_the_mean_of_the_study(bench):
    assert read_target_values(bench).keys() == {"ADD(-S)"}
    assert_targets_have_the_means_of_the_study(bench, "bench")


def test_bench_compares_results_and_times_of_paths(bench):
    result = read_json(bench / "bench.json")
    own, few, same = (result["paths"][name] for name in ("configured", "few", "same"))
    assert own["same_pose"] == same["same_pose"] == 1.0 > few["same_pose"]
    assert "| 3" not in (bench / "bench.md").read_text().split("\n")[0]
    assert "| refine |" in unpadded((bench / "bench.md").read_text())
    assert {"bench.png", "bench.svg"} <= {path.name for path in bench.iterdir()}


def test_a_search_that_is_timed_has_the_same_answers(tiny_run):
    run, estimator = estimator_of(tiny_run)
    frame = run.dataset.frames.load(run.keys[0])
    object_id = next(iter(run.dataset.instances_to_find(frame)))
    found, clock = [], PartClock()
    for observer in (clock.enter, nobody):
        context = estimator.prepare(frame, observer=observer)
        trace = search_frame(context, {object_id: 1}, by_threads=False)[object_id]
        found.append([pose.tolist() for pose in trace.refined.chosen_poses])
        if observer is not nobody:
            assert set(clock.stop()) == set(PARTS)
    assert found[0] == found[1]


def test_a_wrong_path_is_named_before_anything_is_learnt(tiny_run, tmp_path):
    wrong = ("+task.compared.odd.refinement.particels=3", f"work={tmp_path / 'work'}")
    run = tiny_run.build("task=bench", *wrong)
    with pytest.raises(ValueError, match=r"^refinement\.particels is not a key: did you"):
        run.settings.task.run(run, tmp_path / "out")
    assert not (tmp_path / "work").exists()
