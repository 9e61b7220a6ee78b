"""Errors between an estimated and a true pose, pure functions. Metres, radians, pixels.

Poses are `pose_cam_obj` (4, 4), vertices (v, 3) in object coordinates. Symmetries (s, 4, 4) are the
motions that leave the object as it is: for a symmetry S, the true pose T looks the same as T @ S.

ADD(-S) is ADD-S for objects that the evaluation policy calls symmetric, and ADD for all others. The
paper calls it AD.
"""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float
from scipy.spatial import cKDTree

from hlp.arrays import CameraMatrix, Flags, Image, Mask, Points, Pose, Poses, Values
from hlp.evaluation import EvaluationSettings
from hlp.geometry import back_project, inverse, project, rotation_distance, transform
from hlp.records import ObjectModel

VSD_DELTA = 0.015
"""BOP's tolerance (m): a surface counts as visible up to this far behind the observed depth."""
BASIN = 30.0, 30.0
"""Degrees and mm from the truth within which a coarse pose is in the refiner's basin (D)."""
_FLIPPED = 0.1  # of the diameter: ADD-S of a pose that is right but for a turn (D)
_MOTIONS = 1024  # symmetric poses at a time: 10 000 with 3000 votes would take 2 GB


def add(estimated: Pose, true: Pose, vertices: Points) -> float:
    """ADD: mean distance between the vertices at both poses (Hinterstoisser et al., ACCV 2012)."""
    differences = transform(estimated, vertices) - transform(true, vertices)
    return float(np.linalg.norm(differences, axis=1).mean())


def add_s(estimated: Pose, true: Pose, vertices: Points, tree: cKDTree | None = None) -> float:
    """ADD-S: mean distance from each true vertex to the closest estimated one (ibid.).

    For symmetric objects. `tree` may hold a kd-tree over `vertices` that is built once: distances
    stay the same when both sets are moved into the estimate's object coordinates.
    """
    tree = cKDTree(vertices) if tree is None else tree
    moved = transform(inverse(estimated) @ true, vertices)
    return float(tree.query(moved)[0].mean())


def rotation_error(estimated: Pose, true: Pose) -> float:
    """Angle (rad) between both rotations."""
    return float(rotation_distance(estimated[:3, :3], true[:3, :3]))


def translation_error(estimated: Pose, true: Pose) -> float:
    """Distance (m) between both translations."""
    return float(np.linalg.norm(estimated[:3, 3] - true[:3, 3]))


def box_iou(estimated: Pose, true: Pose, vertices: Points, camera_matrix: CameraMatrix) -> float:
    """Intersection over union of the axis-aligned boxes of the projected vertices.

    0 if any part of the object lies behind the camera: its projection would mean nothing.
    """
    points = [transform(pose, vertices) for pose in (estimated, true)]
    if min(part[:, 2].min() for part in points) <= 0:
        return 0.0
    low, high = [], []
    for part in points:
        pixels = project(part, camera_matrix)
        low.append(pixels.min(axis=0))
        high.append(pixels.max(axis=0))
    shared = np.prod(np.maximum(np.minimum(*high) - np.maximum(*low), 0.0))
    return float(shared / (np.prod(high[0] - low[0]) + np.prod(high[1] - low[1]) - shared))


def mssd(estimated: Pose, true: Pose, vertices: Points, symmetries: Poses) -> float:
    """Maximum symmetry-aware surface distance (Hodan et al., BOP Challenge 2020).

    The largest distance of any vertex, minimised over the symmetries. It is convex in the vertex,
    so the vertices of the convex hull are enough.
    """
    moved = transform(estimated, vertices)
    alike = (transform(true @ motion, vertices) for motion in symmetries)
    return min(float(np.linalg.norm(moved - points, axis=1).max()) for points in alike)


def mspd(
    estimated: Pose, true: Pose, vertices: Points, symmetries: Poses, camera_matrix: CameraMatrix
) -> float:
    """Maximum symmetry-aware projection distance in pixels (ibid.).

    Infinite if any part of the estimated object lies behind the camera.
    """
    moved = transform(estimated, vertices)
    if moved[:, 2].min() <= 0:
        return float("inf")
    pixels = project(moved, camera_matrix)
    alike = (project(transform(true @ motion, vertices), camera_matrix) for motion in symmetries)
    return min(float(np.linalg.norm(pixels - others, axis=1).max()) for others in alike)


def vsd(
    estimated_depth: Image,
    true_depth: Image,
    observed_depth: Image,
    camera_matrix: CameraMatrix,
    tolerances: Sequence[float],
    delta: float = VSD_DELTA,
) -> Values:
    """Visible surface discrepancy (ibid.), one value for each misalignment tolerance (m).

    Depth maps (h, w) are in metres, 0 where there is none: the model rendered at both poses, and
    the image. Distances are along the viewing rays. A rendered pixel is visible if it lies at most
    `delta` (m) behind the observed one or none was observed; a pixel of the estimate also where the
    truth is visible.
    """
    height, width = true_depth.shape
    pixels = np.stack(np.meshgrid(np.arange(float(width)), np.arange(float(height))), axis=-1)
    rays = np.linalg.norm(back_project(pixels, np.ones((height, width)), camera_matrix), axis=-1)
    estimated, true, observed = (d * rays for d in (estimated_depth, true_depth, observed_depth))

    def visible(rendered: Image) -> Mask:
        return np.asarray((rendered > 0) & ((rendered - observed <= delta) | (observed == 0)))

    true_seen = visible(true)
    estimated_seen = visible(estimated) | (true_seen & (estimated > 0))
    union = int((true_seen | estimated_seen).sum())
    if union == 0:
        return np.ones(len(tolerances))
    both = true_seen & estimated_seen
    distances = np.abs(estimated[both] - true[both])
    unmatched = union - int(both.sum())
    return np.array([(int((distances >= tau).sum()) + unmatched) / union for tau in tolerances])


def near_truth(
    rotations_cam_obj: Float[np.ndarray, "n 3 3"],
    centroids_cam: Points,
    true: Pose,
    model: ObjectModel,
    settings: EvaluationSettings,
    bounds: tuple[float, float],
) -> Flags:
    """Which pairs of rotation and centroid lie within `bounds` (degrees, mm) of the true pose.

    For an object that the policy calls symmetric, any of the poses that look alike counts as true.
    """
    degrees, millimetres = bounds
    symmetries = model.symmetries if settings.is_symmetric(model) else np.eye(4)[None]
    near = np.zeros(len(rotations_cam_obj), dtype=bool)
    for start in range(0, len(symmetries), _MOTIONS):
        alike = true @ symmetries[start : start + _MOTIONS]
        # The angle between A and B is at most θ where tr(AᵀB) is at least 1 + 2 cos θ.
        traces = rotations_cam_obj.reshape(-1, 9) @ alike[:, :3, :3].reshape(-1, 9).T
        turned = traces >= 1.0 + 2.0 * np.cos(np.deg2rad(degrees))
        centers = transform(alike, model.centroid[None])[:, 0]
        apart = np.linalg.norm(centroids_cam[:, None] - centers[None], axis=2)
        near |= (turned & (apart <= millimetres / 1000.0)).any(axis=1)
    return near


def is_symmetric_flip(
    pose: Pose, true: Pose, model: ObjectModel, settings: EvaluationSettings
) -> bool:
    """Whether a pose is wrong only by a turn that nearly maps the object onto itself.

    It is turned by more than the refiner's basin, and yet its ADD-S is small. Always False for
    objects that the policy calls symmetric: their turned poses are right.
    """
    turned = rotation_error(pose, true) > np.deg2rad(BASIN[0])
    if settings.is_symmetric(model) or not turned:
        return False
    vertices = np.asarray(model.mesh.vertices, dtype=np.float64)
    return add_s(pose, true, vertices) < _FLIPPED * model.diameter
