"""Pictures of the stages of a run, and whether the searches that they show are the run's own."""

from pathlib import Path

import cv2
import pytest
from hydra import compose, initialize_config_dir

from hlp.commands.composing import config_folder
from hlp.config.build import build_run
from hlp.runs.run_stages import stages_of
from hlp.runs.stage_panels import FoundInFrame
from hlp.runs.swarm_traces import search_again
from hlp.stages.detection import DetectionStages
from hlp.stages.store import StageStore
from tiny_run import TinyRun

PICTURES = {"viewpoints", "views", "training_windows", "nearest_entries", "swarm_costs"}
OF_MISSED = "missed_swarm_costs"  # if any target is missed


@pytest.fixture
def detection(tiny_run: TinyRun) -> DetectionStages:
    """The tiny run's stages, all of which are on disk."""
    work = tiny_run.folder / "work"
    given = [*tiny_run.overrides, f"work={work}", "output=out", "machine.threads=1"]
    with initialize_config_dir(str(config_folder()), version_base="1.3"):
        return stages_of(build_run(compose("config", overrides=given)), StageStore(work))


def test_a_run_draws_what_each_stage_works_with(tiny_run: TinyRun) -> None:
    drawn = list((tiny_run.output / "stages").iterdir())
    assert {each.stem for each in drawn} - {OF_MISSED} == PICTURES
    assert {each.suffix for each in drawn} == {".jpg"}
    for path in drawn:
        assert path.stat().st_size < 400_000
        assert min(cv2.imread(str(path)).shape[:2]) > 100


def test_searches_are_repeated_to_the_poses_that_the_run_has_found(
    detection: DetectionStages,
) -> None:
    compared = 0
    for key in detection.keys:
        found = FoundInFrame.read(detection, key, [])
        for object_id in {target.object_id for target in found.frame.targets}:
            refined = found.trace[object_id].refined
            for row, source in enumerate([] if refined is None else refined.sources):
                rounds = search_again(detection, found, object_id, row)
                if source < 0:  # from the fallback
                    assert rounds is None
                    continue
                assert rounds is not None
                assert len(rounds) > 1 and rounds.shape[1] == 25
                compared += 1
    assert compared > 5


def test_pictures_go_where_the_run_goes(tiny_run: TinyRun) -> None:
    said = tiny_run.process.stdout + tiny_run.process.stderr
    assert str(Path("first") / "stages") in said
