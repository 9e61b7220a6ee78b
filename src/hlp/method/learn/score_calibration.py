"""Calibrates the score of an object's poses on rendered scenes, where the truth is known."""

from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
from jaxtyping import Float
from scipy.spatial import cKDTree
from tqdm import tqdm

from hlp.geometry import inverse, transform
from hlp.method.find.estimator import FrameContext, PoseEstimator
from hlp.method.find.search import search_frame
from hlp.method.find.trace import Trace
from hlp.method.learn.calibration_scenes import calibration_scene
from hlp.records import Frame, ObjectModel
from hlp.refinement.pose_fit import PoseFit
from hlp.refinement.score_model import (
    COLORLESS_PRIOR,
    COLORLESS_SPREAD,
    PRIOR,
    SPREAD,
    ScoreModel,
    fit_score_model,
)
from hlp.rendering.views import ViewsSettings

_RIGHT = 0.1  # of the diameter: ADD-S of a right pose is less
_VERTICES = 1000  # of a mesh, about as many are compared
_ABSENT = 3  # every third scene is without the object
_BATCH = 8  # scenes held at a time
_INSTANCES = 2  # answers a scene; the second one is wrong, and looks like the object


def calibrate_score(
    estimator: PoseEstimator,
    object_id: int,
    backgrounds: Sequence[Frame],
    scenes: int,
    rendering: ViewsSettings,
) -> ScoreModel:
    """Search an object in `scenes` rendered ones, and fit the score to what is right there.

    Some scenes are without the object. The estimator must have learnt it. Without scenes the score
    is that of an object of which nothing is known.
    """
    fits, right = [], []
    for fit, is_right in search_scenes(estimator, object_id, backgrounds, scenes, rendering):
        fits.append(fit)
        right.append(is_right)
    colored = estimator.learnt.models[object_id].mesh.colored
    prior, spread = (PRIOR, SPREAD) if colored else (COLORLESS_PRIOR, COLORLESS_SPREAD)
    return fit_score_model(fits, np.array(right, dtype=bool), prior, spread) if fits else prior


def search_scenes(
    estimator: PoseEstimator,
    object_id: int,
    backgrounds: Sequence[Frame],
    scenes: int,
    rendering: ViewsSettings,
) -> Iterator[tuple[PoseFit, bool]]:
    """How each answer to an object in rendered scenes fits, and whether it is right."""
    model, seed = estimator.learnt.models[object_id], estimator.settings.seed
    compare = _Comparison(model)

    def draw(number: int) -> Frame:
        present = number % _ABSENT != _ABSENT - 1
        return calibration_scene(model, present, rendering, backgrounds, number, seed)

    bar = tqdm(desc=f"score of {model.name}", total=scenes, unit="scene", disable=None)
    with bar, ThreadPoolExecutor(estimator.settings.machine.threads) as pool:
        for start in range(0, scenes, _BATCH):
            for frame in pool.map(draw, range(start, min(start + _BATCH, scenes))):
                bar.update()
                context, counts = estimator.prepare(frame), {object_id: _INSTANCES}
                # The fallback would need the score that is about to be calibrated.
                for trace in _searches(estimator, context, counts):
                    found = trace[object_id]
                    poses = [] if found.refined is None else found.refined.chosen_poses
                    for pose, fit in zip(poses, found.fits, strict=True):
                        yield fit, any(compare.right(pose, t.pose_cam_obj) for t in frame.targets)


def _searches(
    estimator: PoseEstimator, context: FrameContext, counts: Mapping[int, int]
) -> Iterator[Trace]:
    """What votes find, and what templates find: both give answers later."""
    trace = search_frame(estimator, context, counts, fallback=False, by_threads=False)
    yield trace
    if any(estimator.has_templates(object_id) for object_id in counts):
        given = {
            i: replace(
                found,
                hypotheses=estimator.match_templates(context, i, counts[i], None),
                refined=None,
            )
            for i, found in trace.items()
        }
        yield search_frame(
            estimator, context, counts, fallback=False, by_threads=False, given=given
        )


class _Comparison:
    """Whether poses of an object are right."""

    def __init__(self, model: ObjectModel) -> None:
        vertices = np.asarray(model.mesh.vertices, dtype=np.float64)
        self._vertices = vertices[:: max(1, len(vertices) // _VERTICES)]
        self._tree = cKDTree(self._vertices)
        self._limit = _RIGHT * model.diameter

    def right(self, pose: Float[np.ndarray, "4 4"], true: Float[np.ndarray, "4 4"]) -> bool:
        """Whether ADD-S is below the limit."""
        moved = transform(inverse(pose) @ true, self._vertices)
        return float(self._tree.query(moved)[0].mean()) < self._limit
