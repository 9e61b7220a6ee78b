"""Poses of a user's own object in their own frames: learn once, find, write, draw."""

import logging
from collections.abc import Sequence
from pathlib import Path

from tqdm import tqdm

from hlp.data.own_frames import OwnFrames
from hlp.evaluation.poses_file import write_poses
from hlp.pipeline.build import Run, evenly
from hlp.pipeline.drawing import picture_of_stages
from hlp.pipeline.finding import Finder
from hlp.pipeline.learning import Learner
from hlp.pipeline.manifest import write_json
from hlp.pipeline.store import StageStore
from hlp.pipeline.threads import set_threads
from hlp.records import PoseEstimate
from hlp.reporting.answers import answers_json, format_answers
from hlp.reporting.panels import write_png


def predict(planned: Run, output: Path) -> list[PoseEstimate]:
    """Find the object in every frame; write poses.csv, poses.json and panels/ into `output`.

    What is learnt about the object is kept in the stage store, for any other frames. Every frame
    is decoded first, so that a broken one is named before anything is learnt. Raises ValueError
    where the frames are not a user's own, and what decoding raises.
    """
    world, settings = planned.world, planned.settings
    if not isinstance(world.frames, OwnFrames):
        raise ValueError("`hlp predict` takes data=files alone; other data are for `hlp run`")
    set_threads(settings)
    for key in planned.keys:
        world.frames.load(key)
    store = StageStore(Path(settings.work))
    finder = Finder(world, settings, Learner(world, settings, store), store, planned.keys)
    answers = finder.estimates()
    images = [str(world.frames.image(_key(answer))) for answer in answers]
    names = {object_id: model.name for object_id, model in world.models.items()}
    output.mkdir(parents=True, exist_ok=True)
    write_poses(output / "poses.csv", answers)
    write_json(output / "poses.json", answers_json(answers, images, names))
    if settings.panels > 0:
        _draw(finder, world.frames, answers, settings.panels, output / "panels")
    print(format_answers(answers, [Path(image).name for image in images], names))
    _say_where(output, settings.panels > 0)
    return answers


def _key(answer: PoseEstimate) -> str:
    return f"{answer.scene_id:06d}_{answer.frame_id:06d}"


def _draw(
    finder: Finder, frames: OwnFrames, answers: Sequence[PoseEstimate], count: int, folder: Path
) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    chosen = evenly(finder.keys, count)
    shown = [answer for answer in answers if _key(answer) in chosen]
    for answer in tqdm(shown, desc="pictures", unit="frame", disable=None):
        key = _key(answer)
        picture = picture_of_stages(finder, frames.load(key), answer.object_id, answer, None)
        write_png(folder / f"{frames.image(key).stem}.png", picture)


def _say_where(output: Path, drawn: bool) -> None:
    say = logging.getLogger(__name__).info
    say("\nPoses     %s (poses.csv in BOP's format, poses.json)", output)
    if drawn:
        say("Pictures  %s (what each stage saw)", output / "panels")
