"""Errors between an estimated and a true pose, pure functions. Metres, radians, pixels.

Poses are `pose_cam_obj` (4, 4), vertices (v, 3) in object coordinates. Symmetries (s, 4, 4) are the
motions that leave the object as it is: for a symmetry S, the true pose T looks the same as T @ S.

ADD(-S) is ADD-S for objects that the evaluation policy calls symmetric, and ADD for all others. The
paper calls it AD.
"""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float
from scipy.spatial import cKDTree

from hlp.geometry import back_project, inverse, project, rotation_distance, transform

Pose = Float[np.ndarray, "4 4"]
Vertices = Float[np.ndarray, "v 3"]
Depth = Float[np.ndarray, "h w"]

VSD_DELTA = 0.015
"""BOP's tolerance (m): a surface counts as visible up to this far behind the observed depth."""


def add(estimated: Pose, true: Pose, vertices: Vertices) -> float:
    """ADD: mean distance between the vertices at both poses (Hinterstoisser et al., ACCV 2012)."""
    differences = transform(estimated, vertices) - transform(true, vertices)
    return float(np.linalg.norm(differences, axis=1).mean())


def add_s(estimated: Pose, true: Pose, vertices: Vertices, tree: cKDTree | None = None) -> float:
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


def nearest_symmetric_pose(
    estimated: Pose, true: Pose, symmetries: Float[np.ndarray, "s 4 4"]
) -> Pose:
    """Of all true poses that look alike, the one whose rotation is closest to the estimate's."""
    alike = true @ symmetries
    angles = rotation_distance(estimated[:3, :3], alike[:, :3, :3])
    return np.asarray(alike[int(np.argmin(angles))])


def box_iou(
    estimated: Pose, true: Pose, vertices: Vertices, camera_matrix: Float[np.ndarray, "3 3"]
) -> float:
    """Intersection over union of the axis-aligned boxes of the projected vertices.

    0 if any part of the object lies behind the camera: its projection would mean nothing.
    """
    boxes = []
    for pose in (estimated, true):
        points = transform(pose, vertices)
        if points[:, 2].min() <= 0:
            return 0.0
        pixels = project(points, camera_matrix)
        boxes.append((pixels.min(axis=0), pixels.max(axis=0)))
    (low_a, high_a), (low_b, high_b) = boxes
    shared = np.prod(np.maximum(np.minimum(high_a, high_b) - np.maximum(low_a, low_b), 0.0))
    return float(shared / (np.prod(high_a - low_a) + np.prod(high_b - low_b) - shared))


def mssd(
    estimated: Pose, true: Pose, vertices: Vertices, symmetries: Float[np.ndarray, "s 4 4"]
) -> float:
    """Maximum symmetry-aware surface distance (Hodan et al., BOP Challenge 2020).

    The largest distance of any vertex, minimised over the symmetries. It is convex in the vertex,
    so the vertices of the convex hull are enough.
    """
    moved = transform(estimated, vertices)
    return min(
        float(np.linalg.norm(moved - transform(true @ motion, vertices), axis=1).max())
        for motion in symmetries
    )


def mspd(
    estimated: Pose,
    true: Pose,
    vertices: Vertices,
    symmetries: Float[np.ndarray, "s 4 4"],
    camera_matrix: Float[np.ndarray, "3 3"],
) -> float:
    """Maximum symmetry-aware projection distance in pixels (ibid.).

    Infinite if any part of the estimated object lies behind the camera.
    """
    moved = transform(estimated, vertices)
    if moved[:, 2].min() <= 0:
        return float("inf")
    pixels = project(moved, camera_matrix)
    return min(
        float(
            np.linalg.norm(
                pixels - project(transform(true @ motion, vertices), camera_matrix), axis=1
            ).max()
        )
        for motion in symmetries
    )


def vsd(
    estimated_depth: Depth,
    true_depth: Depth,
    observed_depth: Depth,
    camera_matrix: Float[np.ndarray, "3 3"],
    tolerances: Sequence[float],
    delta: float = VSD_DELTA,
) -> Float[np.ndarray, "t"]:
    """Visible surface discrepancy (ibid.), one value for each misalignment tolerance (m).

    Depth maps (h, w) are in metres, 0 where there is none: the model rendered at both poses, and
    the image. Distances are along the viewing rays. A rendered pixel is visible if it lies at most
    `delta` behind the observed one or none was observed; a pixel of the estimate also where the
    truth is visible.
    """
    rays = _ray_lengths(true_depth.shape, camera_matrix)
    estimated_m, true_m, observed_m = (
        depth * rays for depth in (estimated_depth, true_depth, observed_depth)
    )
    true_seen = _visible(true_m, observed_m, delta)
    estimated_seen = _visible(estimated_m, observed_m, delta) | (true_seen & (estimated_m > 0))
    union = int((true_seen | estimated_seen).sum())
    both = true_seen & estimated_seen
    if union == 0:
        return np.ones(len(tolerances))
    distances = np.abs(estimated_m[both] - true_m[both])
    unmatched = union - int(both.sum())
    return np.array([(int((distances >= tau).sum()) + unmatched) / union for tau in tolerances])


def _visible(rendered: Depth, observed: Depth, delta: float) -> Bool[np.ndarray, "h w"]:
    return np.asarray((rendered > 0) & ((rendered - observed <= delta) | (observed == 0)))


def _ray_lengths(shape: tuple[int, ...], camera_matrix: Float[np.ndarray, "3 3"]) -> Depth:
    """Distance along the viewing ray per unit of depth, of every pixel."""
    height, width = shape
    pixels = np.stack(np.meshgrid(np.arange(float(width)), np.arange(float(height))), axis=-1)
    points = back_project(pixels, np.ones((height, width)), camera_matrix)
    return np.asarray(np.linalg.norm(points, axis=-1))
