"""`hlp bench` on the tiny run's dataset and stages."""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import torch
from hydra import compose, initialize_config_dir

from hlp.commands.composing import config_folder
from hlp.config.build import Run, build_run
from hlp.method.find.estimator import PoseEstimator
from hlp.method.find.search import search_frame
from hlp.method.stage_settings import FindSettings
from hlp.observer import NOBODY
from hlp.reporting.study_numbers import STUDIES, read_study
from hlp.results.summary_file import read_target_values
from hlp.stages.store import StageStore
from hlp.stages.training import TrainingStages
from hlp.studies.stopwatch import PARTS, PartClock, compare_searches, load_timed
from hlp.studies.tasks import run_task
from table_text import unpadded
from tiny_run import TinyRun

pytestmark = pytest.mark.slow

ARMS = ("+task.compared.few.refinement.particles=3", "+task.compared.same.seed=0")


@pytest.fixture(autouse=True)
def threads() -> Iterator[None]:
    """Tasks set the number of threads of torch and OpenCV."""
    number = torch.get_num_threads()
    yield
    torch.set_num_threads(number)
    cv2.setNumThreads(-1)


def build(tiny_run: TinyRun, *overrides: str) -> Run:
    given = ("task=bench", f"work={tiny_run.folder / 'work'}", "output=out")
    with initialize_config_dir(str(config_folder()), version_base="1.3"):
        return build_run(compose("config", overrides=[*tiny_run.overrides, *given, *overrides]))


@pytest.fixture(scope="module")
def bench(tiny_run: TinyRun, tmp_path_factory: pytest.TempPathFactory) -> Path:
    output = tmp_path_factory.mktemp("bench")
    fast = ("patches.region.scan=fast", "refinement.iterations=4")
    run_task(build(tiny_run, *fast, *ARMS), output)
    return output


def test_bench_states_every_part_of_every_path(bench: Path) -> None:
    result: dict[str, Any] = json.loads((bench / "bench.json").read_text())
    assert set(result["paths"]) == {"configured", "reference", "few", "same"}
    for path in result["paths"].values():
        for view in ("first", "further", "frame"):
            spreads = path[view]
            assert set(PARTS) | {"stage 1", "stage 2", "stage 3", "total"} == set(spreads)
            assert spreads["network" if view == "first" else "refine"]["median_ms"] > 0
            assert all(each["median_ms"] <= each["p95_ms"] for each in spreads.values())
            assert spreads["total"]["cpu_ms"] > 0
        counts = [each["frames"] for each in path["by_objects"].values()]
        assert counts == [2] * 5
    every = result["regions_of_all"]
    assert every["objects"] == 8 and every["median_ms"] > 0
    at_once = result["objects_at_once"]
    assert 0 < at_once["median_ms"] <= at_once["p95_ms"] and at_once["cpu_ms"] > 0
    workload, loading = result["workload"], result["loading_s"]
    assert (workload["frames"], workload["image"], workload["particles"]) == (2, [320, 240], 25)
    assert set(workload["objects"]) == set(loading["objects"]) and len(loading["objects"]) == 8
    assert 0 < loading["classifier"] < 5
    assert 100 < result["memory"]["peak_mib"] <= result["memory"]["all_paths_mib"]
    assert result["memory"]["learnt_too"] == []
    assert result["search"]["recall"] == 1.0  # the tiny run's search is exact
    stages = json.loads((bench / "manifest.json").read_text())["stages"]
    assert stages and all(event["reused"] for event in stages)


def test_times_by_target_have_the_medians_of_the_study(bench: Path) -> None:
    numbers = read_study(bench, STUDIES["bench"])
    assert numbers is not None
    values = {each.name: each.value for each in numbers}
    targets = read_target_values(bench)
    assert values["ADD(-S)"] == pytest.approx(np.mean([*targets.pop("ADD(-S)").values()]))
    assert set(targets) == {"ms first", "ms further", "CPU first", "CPU further"}
    for name, found in targets.items():
        assert values[name] == pytest.approx(np.median([*found.values()]))


def test_bench_compares_results_and_times_of_paths(bench: Path) -> None:
    result: dict[str, Any] = json.loads((bench / "bench.json").read_text())
    compared = result["compared"]
    same = compared["same"]
    assert (same["same_pose"], same["same_verdict"], same["region_iou"]) == (1.0, 1.0, 1.0)
    assert compared["reference"]["changes"]["patches"]["region"] == {"scan": "exact"}
    few = compared["few"]
    assert few["region_iou"] == 1.0 and few["same_pose"] < 1.0
    own, other = (result["paths"][name]["frame"] for name in ("configured", "few"))
    ratio = other["total"]["median_ms"] / own["total"]["median_ms"]
    assert few["ratio"]["frame"]["total"] == pytest.approx(ratio)
    assert "| 3" not in (bench / "bench.md").read_text().split("\n")[0]
    assert "| refine |" in unpadded((bench / "bench.md").read_text())
    assert {"bench.png", "bench.svg"} <= {path.name for path in bench.iterdir()}


def test_a_search_that_is_timed_has_the_same_answers(tiny_run: TinyRun) -> None:
    run = build(tiny_run)
    method = run.settings.method
    training = TrainingStages(run.dataset, method, StageStore(tiny_run.folder / "work"))
    estimator = PoseEstimator(training, FindSettings.of(method), run.dataset.target_ids)
    frame = run.dataset.frames.load(run.keys[0])
    object_id = next(iter(run.dataset.wanted(frame)))
    found, clock = [], PartClock()
    clock.start()
    for observer in (clock, NOBODY):
        context = estimator.prepare(frame, observer=observer)
        trace = search_frame(estimator, context, {object_id: 1}, by_threads=False)[object_id]
        assert trace.refined is not None
        found.append([pose.tolist() for pose in trace.refined.chosen_poses])
        if observer is clock:
            assert set(clock.stop()) == set(PARTS)
    assert found[0] == found[1]


@pytest.mark.parametrize(
    ("overrides", "indices"),
    [(("codebook=inverted_lists",), 2), (("codebook=joint_lists", "patches.local.size_mm=45"), 1)],
)
def test_each_index_is_compared_with_an_exact_search_once_a_frame(
    tiny_run: TinyRun, overrides: tuple[str, ...], indices: int
) -> None:
    run = build(tiny_run, *overrides)
    method, wanted = run.settings.method, run.dataset.target_ids[:2]
    training = TrainingStages(run.dataset, method, StageStore(tiny_run.folder / "work"))
    training.make_for(run.dataset.target_ids)
    estimator = PoseEstimator(training, FindSettings.of(method), run.dataset.target_ids)
    load_timed(estimator, wanted)
    context = estimator.prepare(run.dataset.frames.load(run.keys[0]))
    regions = [estimator.find_region(context, object_id) for object_id in wanted]
    patches = [estimator.find_hypotheses(context, region).patches for region in regions]
    compared = compare_searches(estimator, dict(zip(wanted, patches, strict=True)))
    assert [each.queries for each in compared] == [len(own) for own in patches[:indices]]
    assert all(0.5 < each.recall <= 1.0 for each in compared)


def test_a_wrong_path_is_named_before_anything_is_learnt(tiny_run: TinyRun, tmp_path: Path) -> None:
    wrong = build(tiny_run, "+task.compared.odd.refinement.particels=3", f"work={tmp_path / 'w'}")
    with pytest.raises(ValueError, match=r"^refinement\.particels is no key: did you"):
        run_task(wrong, tmp_path / "out")
    assert not (tmp_path / "w").exists()
