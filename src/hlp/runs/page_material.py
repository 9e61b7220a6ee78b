"""Pictures and scenes for the page of a run: of missed targets, up to a limit, and some right."""

import logging
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path

import cv2
import numpy as np
from jaxtyping import Bool, Float, UInt8
from tqdm import tqdm

from hlp.config.build import Run
from hlp.files import SCORES
from hlp.geometry import back_project, transform
from hlp.objects.meshes import decimate
from hlp.records import Frame, ObjectModel, PoseEstimate, TargetScore, frame_key
from hlp.reporting.comparison import read_targets
from hlp.reporting.mlflow_run import MlflowRun
from hlp.reporting.page.material import (
    FOLDER,
    PageObject,
    PageTarget,
    edges_of,
    read_material,
    write_material,
)
from hlp.reporting.sweep_log import drawn_stages
from hlp.results.summary_file import TargetKey
from hlp.runs.stage_panels import PANELS, FoundInFrame, in_order_of_scores, picture_of_target
from hlp.stages.detection import DetectionStages

MISSED, RIGHT = 300, 8
"""The largest numbers of missed and of right targets that are drawn: each takes some tenths of a
second and 0.2 MB."""
_WIDTH = 1280  # px of a picture
_FACES = 300  # of a model in the 3D view
_POINTS = 2500  # of a scene in the 3D view
_AROUND = 1.1  # diameters from the object's true and found places that are in the 3D view

Chosen = list[tuple[TargetKey, int]]
"""Targets with their place among those of their frame."""


def keep_material(
    run: Run,
    detection: DetectionStages,
    estimates: Sequence[PoseEstimate],
    scores: Sequence[TargetScore],
    output: Path,
) -> None:
    """Write what the page of this run shows beside its results; no pictures with `panels=0`.

    `scores` holds the frames' targets in their order. Nothing that goes wrong here costs the run
    its results: it is logged, with its traceback.
    """
    try:
        usable = [each for each in scores if _key(each) not in detection.failed]
        chosen = choose_targets(usable) if run.settings.panels > 0 else []
        keyed = {key: score for (key, _), score in zip(_keyed(usable), usable, strict=True)}
        frames = tqdm(_by_frame(chosen), desc="pictures of targets", unit="frame", disable=None)
        targets = [each for group in frames for each in _draw(detection, group, estimates, keyed)]
        models = detection.dataset.models
        asked = {score.object_id for score in scores}
        objects = {models[i].name: _object(models[i]) for i in sorted(asked)}
        write_material(output, objects, targets)
    except Exception:
        logging.getLogger(__name__).exception("the pictures of the report could not be made")


def choose_targets(scores: Sequence[TargetScore]) -> Chosen:
    """Missed targets, and right ones, each evenly over the run if there are too many."""
    keyed = list(zip(_keyed(scores), scores, strict=True))
    missed = [place for place, score in keyed if not score.add_correct]
    right = [place for place, score in keyed if score.add_correct]
    return sorted([*_evenly(missed, MISSED), *_evenly(right, RIGHT)])


def _keyed(scores: Sequence[TargetScore]) -> Chosen:
    """Key of each target, and its place among those of its frame."""
    instances: Counter[tuple[int, int, int]] = Counter()
    places: Counter[tuple[int, int]] = Counter()
    keyed = []
    for score in scores:
        frame = (score.scene_id, score.frame_id)
        same = (*frame, score.object_id)
        keyed.append(((*same, instances[same]), places[frame]))
        instances[same] += 1
        places[frame] += 1
    return keyed


def _evenly(chosen: Chosen, most: int) -> Chosen:
    if len(chosen) <= most:
        return chosen
    return [chosen[i * len(chosen) // most] for i in range(most)]


def _key(score: TargetScore) -> str:
    return frame_key(score.scene_id, score.frame_id)


def _by_frame(chosen: Chosen) -> list[Chosen]:
    frames: dict[tuple[int, int], Chosen] = {}
    for key, place in chosen:
        frames.setdefault(key[:2], []).append((key, place))
    return list(frames.values())


def _draw(
    detection: DetectionStages,
    chosen: Chosen,
    estimates: Sequence[PoseEstimate],
    scores: Mapping[TargetKey, TargetScore],
) -> list[PageTarget]:
    """The chosen targets of one frame."""
    found = FoundInFrame.read(detection, frame_key(*chosen[0][0][:2]), estimates)
    frame, drawn = found.frame, []
    for target_key, place in chosen:
        target = in_order_of_scores(frame)[place]
        model = detection.dataset.models[target.object_id]
        best = found.nearest(target)
        picture = picture_of_target(detection, found, target, scores[target_key])
        height = round(picture.shape[0] * _WIDTH / picture.shape[1])
        small = cv2.resize(picture, (_WIDTH, height), interpolation=cv2.INTER_AREA).astype(np.uint8)
        pose = None if best is None else best.pose_cam_obj
        near = _near(frame, model, [target.pose_cam_obj, *([] if pose is None else [pose])])
        scene = _scene(frame, near)
        drawn.append(PageTarget(target_key, small, *scene, target.pose_cam_obj, pose))
    return drawn


def _near(
    frame: Frame, model: ObjectModel, poses: Sequence[Float[np.ndarray, "4 4"]]
) -> Bool[np.ndarray, "h w"]:
    """Measured pixels whose points are near the object in one of the poses."""
    points = _points(frame)
    near = np.zeros(frame.depth.shape, dtype=bool)
    for pose in poses:
        center = transform(pose, model.centroid[None])[0]
        near |= ((points - center) ** 2).sum(axis=-1) < (_AROUND * model.diameter) ** 2
    return near & (frame.depth > 0)


def _scene(
    frame: Frame, near: Bool[np.ndarray, "h w"]
) -> tuple[Float[np.ndarray, "n 3"], UInt8[np.ndarray, "n 3"]]:
    """At most `_POINTS` of the chosen pixels as coloured points, at random but repeatable."""
    indices = np.flatnonzero(near)
    if len(indices) > _POINTS:
        indices = np.random.default_rng(0).choice(indices, _POINTS, replace=False)
    return _points(frame).reshape(-1, 3)[indices], frame.rgb.reshape(-1, 3)[indices]


def _points(frame: Frame) -> Float[np.ndarray, "h w 3"]:
    """The point (m) that every pixel shows."""
    height, width = frame.depth.shape
    y, x = np.indices((height, width)).reshape(2, -1)
    pixels = np.stack([x, y], axis=1).astype(np.float64)
    points = back_project(pixels, frame.depth.ravel(), frame.camera_matrix)
    return points.reshape(height, width, 3)


def _object(model: ObjectModel) -> PageObject:
    mesh = decimate(model.proxy, _FACES)
    return PageObject(model.diameter, mesh.vertices, edges_of(mesh.faces))


MOST_MISSES = 12
"""Missed targets that are logged; the report shows more."""
_GROUP = "1. Pictures"  # MLflow sorts the groups on a run's page by name


def log_pictures(output: Path, tracker: MlflowRun) -> None:
    """Log poses and panels, a step for each frame; missed targets by cause; those of stages.

    The frame's number is the step, so equal steps of two runs show the same frame.
    """
    for path in sorted((output / PANELS).glob("*.jpg")):
        scene, frame, drawn = path.stem.split("_", 2)
        what = "poses" if drawn == "poses" else "panels"
        tracker.log_image(path, f"{_GROUP}/{what} in scene {int(scene)}", int(frame))
    for path in drawn_stages(output).values():
        tracker.log_image(path, f"{_GROUP}/stages - {path.stem.replace('_', ' ')}", 0)
    scores = read_targets(output / SCORES)
    shown = read_material(output).targets
    missed = [key for key in sorted(shown) if key in scores and not scores[key].correct("add")]
    counted: dict[str, int] = {}
    for key in missed[:: max(1, -(-len(missed) // MOST_MISSES))]:
        cause = (scores[key].score.cause or "unknown").replace("_", " ")
        counted[cause] = step = counted.get(cause, -1) + 1
        tracker.log_image(_picture(output, shown[key]), f"{_GROUP}/missed - {cause}", step)


def _picture(output: Path, target: Mapping[str, str]) -> Path:
    return output / FOLDER / target["picture"]
