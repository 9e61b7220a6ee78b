"""Calibrates the score of an object's poses on rendered scenes, where the truth is known."""

from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from functools import partial

import numpy as np
from scipy.spatial import cKDTree

from hlp.geometry import inverse, transform
from hlp.method.find.estimator import PoseEstimator
from hlp.method.find.search import search_frame
from hlp.method.find.trace import ObjectTrace
from hlp.method.learn.calibration_scenes import calibration_scene
from hlp.progress import Progress
from hlp.records import Frame
from hlp.refinement.pose_fit import PoseFit
from hlp.refinement.score_model import PRIOR, ScoreModel, fit_score_model
from hlp.rendering.views import ViewsSettings

_RIGHT = 0.1  # of the diameter: ADD-S of a right pose is less
_VERTICES = 1000  # of a mesh, about as many are compared
_ABSENT = 3  # every third scene is without the object
_BATCH = 4  # scenes held at a time
_INSTANCES = 2  # answers a scene; the second one is wrong, and looks like the object


def calibrate_score(
    estimator: PoseEstimator,
    object_id: int,
    backgrounds: Sequence[Frame],
    scenes: int,
    rendering: ViewsSettings,
) -> ScoreModel:
    """Search an object in `scenes` rendered ones, and fit the score to what is right there.

    Some scenes are without the object. The estimator must have learnt it. Objects with colours
    share one score, which such a fit hardly changes; without scenes so do those without.
    """
    if estimator.learnt.models[object_id].mesh.colored:
        return PRIOR
    found = list(search_scenes(estimator, object_id, backgrounds, scenes, rendering))
    right = np.array([is_right for _, is_right in found], dtype=bool)
    return fit_score_model([fit for fit, _ in found], right)


def search_scenes(
    estimator: PoseEstimator,
    object_id: int,
    backgrounds: Sequence[Frame],
    scenes: int,
    rendering: ViewsSettings,
) -> Iterator[tuple[PoseFit, bool]]:
    """How each answer to an object in rendered scenes fits, and whether it is right: by ADD-S."""
    model, seed = estimator.learnt.models[object_id], estimator.settings.seed
    vertices = np.asarray(model.mesh.vertices, dtype=np.float64)
    vertices = vertices[:: max(1, len(vertices) // _VERTICES)]
    tree, limit = cKDTree(vertices), _RIGHT * model.diameter

    def draw(number: int) -> Frame:
        present = number % _ABSENT != _ABSENT - 1
        return calibration_scene(model, present, rendering, backgrounds, number, seed)

    def is_right(pose: np.ndarray, true: np.ndarray) -> bool:
        moved = transform(inverse(pose) @ true, vertices)
        return float(tree.query(moved)[0].mean()) < limit

    bar = Progress(None, f"score of {model.name}", scenes, unit="scene")
    with bar, ThreadPoolExecutor(estimator.settings.machine.threads) as pool:
        for start in range(0, scenes, _BATCH):
            for frame in pool.map(draw, range(start, min(start + _BATCH, scenes))):
                bar.update()
                for found in _searches(estimator, frame, object_id):
                    poses = [] if found.refined is None else found.refined.chosen_poses
                    for pose, fit in zip(poses, found.fits, strict=True):
                        yield fit, any(is_right(pose, t.pose_cam_obj) for t in frame.targets)


def _searches(estimator: PoseEstimator, frame: Frame, object_id: int) -> Iterator[ObjectTrace]:
    """What votes find, and what templates find: both give answers later."""
    context, counts = estimator.prepare(frame), {object_id: _INSTANCES}
    # The fallback would need the score that is about to be calibrated.
    search = partial(search_frame, context, counts, fallback=False, by_threads=False)
    found = search()[object_id]
    yield found
    if estimator.has_templates(object_id):
        coarse = estimator.match_templates(context, object_id, _INSTANCES, None)
        yield search(given={object_id: replace(found, hypotheses=coarse, refined=None)})[object_id]
