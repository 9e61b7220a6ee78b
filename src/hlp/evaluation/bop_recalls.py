"""BOP's recalls of one object in one frame: VSD, MSSD and MSPD (BOP Challenge 2020, Sec. 2.2).

They agree with the BOP toolkit, which differs from the rest of HLP in two respects. Estimates are
matched to the instances for each error and each threshold anew. And it renders half a pixel off:
its projection matrix takes the image to begin at coordinate 0, as OpenGL does, which samples pixel
i at i + 0.5; its distances along the rays take the centre of pixel i at i, as we do.
"""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float, Int
from scipy.spatial import ConvexHull, QhullError

from hlp.arrays import CameraMatrix, Image, Mask, Points, Pose, Values
from hlp.evaluation import errors
from hlp.geometry import project, transform
from hlp.records import Frame, Mesh, ObjectModel, Target
from hlp.rendering.rasterizer import NEAR, render_depth

FRACTIONS = np.arange(1, 11) * 0.05
"""Thresholds of VSD, its tolerances as fractions of the diameter, and thresholds of MSSD."""
PIXELS = np.arange(1, 11) * 5.0
"""Thresholds of MSPD for an image of 640 pixels in width."""
WIDTH = 640
"""Width (px) of the images that `PIXELS` are for."""
_HALF_A_PIXEL = np.array([[0, 0, 0.5], [0, 0, 0.5], [0, 0, 0]])


class BopRecalls:
    """Recalls of one object, with the errors measured on `mesh` (BOP: that of `models_eval`).

    `delta` (m) is VSD's.
    """

    def __init__(self, model: ObjectModel, mesh: Mesh, delta: float = errors.VSD_DELTA) -> None:
        self._mesh, self._diameter, self._symmetries = mesh, model.diameter, model.symmetries
        self._hull, self._delta = hull_vertices(mesh), delta

    def of(
        self,
        true_poses: Sequence[Pose],
        estimates: Sequence[Pose],
        camera_matrix: CameraMatrix,
        width: int,
        depth: Image | None,
    ) -> Float[np.ndarray, "n 3"]:
        """Recalls of VSD, MSSD and MSPD of each of n instances, averaged over BOP's thresholds.

        `estimates` are the poses to score, the surest first. VSD is nan without a depth image (m).
        """
        pairs = [(estimate, true) for estimate in estimates for true in true_poses]
        mssd, mspd = self.distances(true_poses, estimates, camera_matrix)
        recalls = np.full((len(true_poses), 3), np.nan)
        if depth is not None:
            values = [self._vsd(*pair, camera_matrix, depth) for pair in pairs]
            vsd = np.reshape(values, (*mssd.shape, len(FRACTIONS)))
            recalls[:, 0] = _recalls(vsd, FRACTIONS)
        recalls[:, 1] = _recalls(mssd[..., None], FRACTIONS * self._diameter)
        recalls[:, 2] = _recalls(mspd[..., None], PIXELS * width / WIDTH)
        return recalls

    def distances(
        self, true_poses: Sequence[Pose], estimates: Sequence[Pose], camera_matrix: CameraMatrix
    ) -> tuple[Float[np.ndarray, "m n"], Float[np.ndarray, "m n"]]:
        """MSSD (m) and MSPD (px) of each of m estimates against each of n true poses."""
        pairs = [(estimate, true) for estimate in estimates for true in true_poses]
        shape, surface = (len(estimates), len(true_poses)), (self._hull, self._symmetries)
        mssd = np.array([errors.mssd(*pair, *surface) for pair in pairs], dtype=np.float64)
        # The error is largest on the convex hull, up to an effect of perspective that is far below
        # the thresholds' steps of 5 px.
        mspd = [errors.mspd(*pair, *surface, camera_matrix) for pair in pairs]
        return mssd.reshape(shape), np.array(mspd, dtype=np.float64).reshape(shape)

    def _vsd(
        self, estimated: Pose, true: Pose, camera_matrix: CameraMatrix, observed: Image
    ) -> Values:
        """VSD for each tolerance. Only the part of the image with the object is rendered."""
        height, width = observed.shape
        boxes = [self._box(pose, camera_matrix, width, height) for pose in (estimated, true)]
        lows, highs = np.array([low for low, _ in boxes]), np.array([high for _, high in boxes])
        if (highs.min(axis=0) <= lows.max(axis=0)).any():  # they share no pixel
            return np.ones(len(FRACTIONS))
        (left, top), (right, bottom) = lows.min(axis=0).tolist(), highs.max(axis=0).tolist()
        crop = camera_matrix - np.array([[0, 0, left], [0, 0, top], [0, 0, 0]])
        poses, size = np.stack([estimated, true]), (bottom - top, right - left)
        rendered = render_depth(self._mesh, poses, crop - _HALF_A_PIXEL, size, 1)
        seen, tolerances = observed[top:bottom, left:right], list(FRACTIONS * self._diameter)
        return errors.vsd(rendered[0], rendered[1], seen, crop, tolerances, self._delta)

    def _box(
        self, pose: Pose, camera_matrix: CameraMatrix, width: int, height: int
    ) -> tuple[np.ndarray, np.ndarray]:
        """First and (exclusive) last x and y of the pixels that may show the object."""
        points, size = transform(pose, self._hull), np.array([width, height])
        if points[:, 2].min() <= NEAR:
            return np.zeros(2, dtype=int), size
        pixels = project(points, camera_matrix)
        low, high = np.floor(pixels.min(axis=0)) - 1, np.ceil(pixels.max(axis=0)) + 2
        return np.clip(low, 0, size).astype(int), np.clip(high, 0, size).astype(int)


def hull_vertices(mesh: Mesh) -> Points:
    """The vertices of a mesh that lie on its convex hull; all vertices of a flat mesh."""
    vertices = np.asarray(mesh.vertices, dtype=np.float64)
    try:
        return np.asarray(vertices[ConvexHull(vertices).vertices])
    except QhullError:
        return vertices


def match(distances: Float[np.ndarray, "m n t"], limits: Values) -> Int[np.ndarray, "m t k"]:
    """The instance, of n, that each of m estimates is matched to for each of k limits; -1: none.

    As in the BOP toolkit, each estimate in turn takes the closest instance that is still free, if
    it lies below the limit.
    """
    count, instances, tolerances = distances.shape
    matched = np.full((count, tolerances, len(limits)), -1)
    taken = np.zeros((instances, tolerances, len(limits)), dtype=bool)
    for row, own in zip(distances if instances else (), matched, strict=False):
        free = np.where(taken | (row[:, :, None] >= limits), np.inf, row[:, :, None])
        nearest = free.argmin(axis=0)
        own[...] = np.where(np.isfinite(free.min(axis=0)), nearest, -1)
        taken |= np.arange(instances)[:, None, None] == own
    return matched


def _recalls(distances: Float[np.ndarray, "m n t"], limits: Values) -> Values:
    """Of each of n instances, the share of tolerances and limits for which it is matched."""
    matched = match(distances, limits)[:, None]
    instances = np.arange(distances.shape[1])[:, None, None]
    return np.asarray((matched == instances).any(axis=0).mean(axis=(1, 2)))


def unoccluded_mask(frame: Frame, target: Target, model: ObjectModel) -> Mask:
    """Pixels where nothing is seen in front of the target (BOP's rule for visibility).

    The object in its true pose lies in front of the observed depth, at it, or at most
    `errors.VSD_DELTA` behind it. Pixels without depth count. Renders `model.proxy`.
    """
    rendered = _rendered(model.proxy, frame, target)
    hidden = (frame.depth > 0) & (rendered - frame.depth > errors.VSD_DELTA)
    return np.asarray((rendered > 0) & ~hidden)


def measured_mask(frame: Frame, target: Target, model: ObjectModel, tolerance: float) -> Mask:
    """Pixels whose observed depth is within `tolerance` (m) of the target's in its true pose.

    Renders `model.mesh`.
    """
    rendered = _rendered(model.mesh, frame, target)
    both = (rendered > 0.0) & (frame.depth > 0.0)
    return np.asarray(both & (np.abs(rendered - frame.depth) <= tolerance))


def _rendered(mesh: Mesh, frame: Frame, target: Target) -> Image:
    shape, poses = (frame.depth.shape[0], frame.depth.shape[1]), target.pose_cam_obj[None]
    return np.asarray(render_depth(mesh, poses, frame.camera_matrix, shape, threads=1)[0])
