"""Pictures and scenes for the page of a run: all missed targets, up to a number, and some right."""

import logging
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np
from jaxtyping import Bool, Float, UInt8

from hlp.config.build import Run
from hlp.geometry import back_project, transform
from hlp.objects.meshes import decimate
from hlp.records import Frame, ObjectModel, PoseEstimate, Target, TargetScore, frame_key
from hlp.reporting.comparison import TargetKey
from hlp.reporting.figures.panels import draw_panels
from hlp.reporting.page.material import PageObject, PageTarget, edges_of, write_material
from hlp.stages.detection import DetectionStages
from hlp.stages.frame_files import read_arrays
from hlp.stages.frame_results import regions_of, votes_of

MISSED, RIGHT = 40, 8
"""The largest numbers of missed and of right targets that are shown."""
_WIDTH = 880  # px of a picture
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
        targets = [
            each for group in _by_frame(chosen) for each in _draw(detection, group, estimates)
        ]
        models = detection.dataset.models
        asked = {score.object_id for score in scores}
        objects = {models[i].name: _object(models[i]) for i in sorted(asked)}
        write_material(output, objects, targets)
    except Exception:
        logging.getLogger(__name__).exception("the pictures of the report could not be made")


def choose_targets(scores: Sequence[TargetScore]) -> Chosen:
    """Missed targets, and right ones, each evenly over the run if there are too many."""
    instances: Counter[tuple[int, int, int]] = Counter()
    places: Counter[tuple[int, int]] = Counter()
    keyed = []
    for score in scores:
        frame = (score.scene_id, score.frame_id)
        same = (*frame, score.object_id)
        keyed.append((((*same, instances[same])), places[frame], score.add_correct))
        instances[same] += 1
        places[frame] += 1
    missed = [(key, place) for key, place, right in keyed if not right]
    right = [(key, place) for key, place, right in keyed if right]
    return sorted([*_evenly(missed, MISSED), *_evenly(right, RIGHT)])


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
    detection: DetectionStages, chosen: Chosen, estimates: Sequence[PoseEstimate]
) -> list[PageTarget]:
    """The chosen targets of one frame."""
    scene_id, frame_id = chosen[0][0][:2]
    key = frame_key(scene_id, frame_id)
    frame = detection.load(key)
    size = (frame.depth.shape[0], frame.depth.shape[1])
    regions = regions_of(read_arrays(detection.regions().folder, key), size)
    coarse = read_arrays(detection.hypotheses().folder, key)
    drawn = []
    for target_key, place in chosen:
        target = frame.targets[place]
        model = detection.dataset.models[target.object_id]
        best = _nearest(estimates, frame, target)
        votes = votes_of(coarse, target.object_id)
        picture = draw_panels(frame, model, regions[target.object_id], votes, best, target)
        height = round(picture.shape[0] * _WIDTH / picture.shape[1])
        small = cv2.resize(picture, (_WIDTH, height), interpolation=cv2.INTER_AREA).astype(np.uint8)
        pose = None if best is None else best.pose_cam_obj
        near = _near(frame, model, [target.pose_cam_obj, *([] if pose is None else [pose])])
        scene = _scene(frame, near)
        drawn.append(PageTarget(target_key, small, *scene, target.pose_cam_obj, pose))
    return drawn


def _nearest(
    estimates: Sequence[PoseEstimate], frame: Frame, target: Target
) -> PoseEstimate | None:
    """The estimate of the target's object that is nearest to its true place."""
    wanted = (frame.scene_id, frame.frame_id, target.object_id)
    found = [
        each
        for each in estimates
        if (each.scene_id, each.frame_id, each.object_id) == wanted
        and each.pose_cam_obj is not None
    ]
    return min(found, key=lambda each: _distance(each, target), default=None)


def _distance(estimate: PoseEstimate, target: Target) -> float:
    assert estimate.pose_cam_obj is not None
    return float(np.linalg.norm(estimate.pose_cam_obj[:3, 3] - target.pose_cam_obj[:3, 3]))


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
