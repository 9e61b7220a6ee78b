"""`hlp predict`: poses of a user's own object in their own frames."""

import logging
from collections.abc import Sequence
from pathlib import Path

from tqdm import tqdm

from hlp.config.build import Run, evenly
from hlp.data.own_frames import OwnFrames
from hlp.errors import InputError
from hlp.files import POSES, write_json
from hlp.method.compute_threads import set_compute_threads
from hlp.records import PoseEstimate, frame_key
from hlp.reporting.figures.panels import write_png
from hlp.reporting.tables.pose_table import format_poses, poses_json
from hlp.results.poses_file import write_poses
from hlp.runs.run_stages import stages_of
from hlp.runs.stage_panels import picture_of_stages
from hlp.stages.detection import DetectionStages
from hlp.stages.store import StageStore


def predict(run: Run, output: Path) -> list[PoseEstimate]:
    """Find the object in every frame; write poses.csv, poses.json and panels/ into `output`.

    What is learnt about the object stays in the stage store, to be used for other frames. Every
    frame is decoded first, so that a broken one is reported before anything is learnt. Raises
    InputError if the frames are not the user's own, and the errors of decoding.
    """
    dataset, settings = run.dataset, run.settings
    if not isinstance(dataset.frames, OwnFrames):
        raise InputError("`hlp predict` takes data=files alone; other data are for `hlp run`")
    set_compute_threads(settings.machine.threads)
    for key in run.keys:
        dataset.frames.load(key)
    store = StageStore(Path(settings.work))
    detection = stages_of(run, store)
    estimates = detection.estimates()
    images = [str(dataset.frames.image(_key(estimate))) for estimate in estimates]
    names = {object_id: model.name for object_id, model in dataset.models.items()}
    output.mkdir(parents=True, exist_ok=True)
    write_poses(output / POSES, estimates)
    write_json(output / "poses.json", poses_json(estimates, images, names))
    if settings.panels > 0:
        _draw(detection, dataset.frames, estimates, settings.panels, output / "panels")
    print(format_poses(estimates, [Path(image).name for image in images], names))
    _say_where(output, settings.panels > 0)
    return estimates


def _key(estimate: PoseEstimate) -> str:
    return frame_key(estimate.scene_id, estimate.frame_id)


def _draw(
    detection: DetectionStages,
    frames: OwnFrames,
    estimates: Sequence[PoseEstimate],
    count: int,
    folder: Path,
) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    chosen = evenly(detection.keys, count)
    shown = [estimate for estimate in estimates if _key(estimate) in chosen]
    for estimate in tqdm(shown, desc="pictures", unit="frame", disable=None):
        key = _key(estimate)
        picture = picture_of_stages(detection, frames.load(key), estimate.object_id, estimate, None)
        write_png(folder / f"{frames.image(key).stem}.png", picture)


def _say_where(output: Path, drawn: bool) -> None:
    say = logging.getLogger(__name__).info
    say("\nPoses     %s (poses.csv in BOP's format, poses.json)", output)
    if drawn:
        say("Pictures  %s (what each stage saw)", output / "panels")
