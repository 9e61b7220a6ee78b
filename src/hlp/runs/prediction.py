"""`hlp predict`: poses of a user's own object in their own frames."""

import logging
from collections.abc import Mapping
from pathlib import Path

from hlp.config.build import Run
from hlp.data.own_frames import OwnFrames
from hlp.errors import InputError
from hlp.files import POSES, write_json
from hlp.method.compute_threads import set_compute_threads
from hlp.records import PoseEstimate, frame_key
from hlp.reporting.figures.panels import write_png
from hlp.reporting.tables.pose_table import format_poses, poses_json
from hlp.results.poses_file import write_poses
from hlp.runs.run_stages import stages_of
from hlp.runs.stage_panels import drawn_frames, picture_of_stages
from hlp.stages.frame_results import Arrays
from hlp.stages.store import StageStore


def predict(run: Run, output: Path) -> list[PoseEstimate]:
    """Find the object in every frame; write poses.csv, poses.json and panels/ into `output`.

    What is learnt about the object stays in the stage store, to be used for other frames. Raises
    InputError if the frames are not the user's own, and the errors of decoding: before an object is
    learnt, which takes minutes, every frame is decoded once to find a broken one.
    """
    dataset, settings = run.dataset, run.settings
    frames = dataset.frames
    if not isinstance(frames, OwnFrames):
        raise InputError("`hlp predict` takes data=files alone; other data are for `hlp run`")
    set_compute_threads(settings.machine.threads)
    detection = stages_of(run, StageStore(Path(settings.work)))
    if detection.training.missing_views():  # nothing is learnt yet
        for key in run.keys:
            detection.load(key)
    scores = detection.scores()
    drawn, panels = drawn_frames(run), output / "panels"

    def draw(key: str, found: Mapping[str, Arrays]) -> None:
        if key in drawn:
            (model,) = dataset.models.values()
            panels.mkdir(parents=True, exist_ok=True)
            picture = picture_of_stages(detection.load(key), found, model, scores, None)
            write_png(panels / f"{frames.image(key).stem}.png", picture)

    estimates = detection.estimates(draw)
    images = [str(frames.image(_key(estimate))) for estimate in estimates]
    names = {object_id: model.name for object_id, model in dataset.models.items()}
    output.mkdir(parents=True, exist_ok=True)
    write_poses(output / POSES, estimates)
    write_json(output / "poses.json", poses_json(estimates, images, names))
    print(format_poses(estimates, [Path(image).name for image in images], names))
    _say_where(output, settings.panels > 0)
    return estimates


def _key(estimate: PoseEstimate) -> str:
    return frame_key(estimate.scene_id, estimate.frame_id)


def _say_where(output: Path, drawn: bool) -> None:
    say = logging.getLogger(__name__).info
    say("\nPoses     %s (poses.csv in BOP's format, poses.json)", output)
    if drawn:
        say("Pictures  %s (what each stage saw)", output / "panels")
