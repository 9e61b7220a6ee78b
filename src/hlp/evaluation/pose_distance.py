"""Which poses and votes are near the truth, up to the object's symmetries. Metres, degrees."""

import numpy as np
from jaxtyping import Bool, Float

from hlp.evaluation import errors
from hlp.evaluation.settings import EvaluationSettings
from hlp.geometry import transform
from hlp.records import ObjectModel

Pose = Float[np.ndarray, "4 4"]
_MOTIONS = 1024  # symmetric poses at a time: 10 000 with 3000 votes would take 2 GB


def near_truth(
    rotations_cam_obj: Float[np.ndarray, "n 3 3"],
    centroids_cam: Float[np.ndarray, "n 3"],
    true: Pose,
    model: ObjectModel,
    settings: EvaluationSettings,
    bounds: tuple[float, float],
) -> Bool[np.ndarray, "n"]:
    """Which pairs of rotation and centroid lie within `bounds` (degrees, mm) of the true pose.

    For an object that the policy calls symmetric, any of the poses that look alike counts as true.
    """
    degrees, millimetres = bounds
    symmetries = _symmetries(model, settings)
    near = np.zeros(len(rotations_cam_obj), dtype=bool)
    for i in range(0, len(symmetries), _MOTIONS):
        alike = true @ symmetries[i : i + _MOTIONS]
        near |= _near_any(rotations_cam_obj, centroids_cam, alike, model, (degrees, millimetres))
    return near


def _near_any(
    rotations_cam_obj: Float[np.ndarray, "n 3 3"],
    centroids_cam: Float[np.ndarray, "n 3"],
    alike: Float[np.ndarray, "s 4 4"],
    model: ObjectModel,
    bounds: tuple[float, float],
) -> Bool[np.ndarray, "n"]:
    """Which pairs are near one of several poses."""
    degrees, millimetres = bounds
    # The angle between A and B is at most θ where tr(AᵀB) is at least 1 + 2 cos θ.
    traces = rotations_cam_obj.reshape(-1, 9) @ alike[:, :3, :3].reshape(-1, 9).T
    turned = traces >= 1.0 + 2.0 * np.cos(np.deg2rad(degrees))
    centers = transform(alike, model.centroid[None])[:, 0]
    apart = np.linalg.norm(centroids_cam[:, None] - centers[None], axis=2)
    return np.asarray((turned & (apart <= millimetres / 1000.0)).any(axis=1))


def poses_near_truth(
    poses_cam_obj: Float[np.ndarray, "n 4 4"],
    true: Pose,
    model: ObjectModel,
    settings: EvaluationSettings,
    bounds: tuple[float, float],
) -> Bool[np.ndarray, "n"]:
    """`near_truth` for poses. Distances are between centroids, so a pure turn has distance 0."""
    centroids = transform(poses_cam_obj, model.centroid[None])[:, 0]
    return near_truth(poses_cam_obj[:, :3, :3], centroids, true, model, settings, bounds)


def is_symmetric_flip(
    pose: Pose, true: Pose, model: ObjectModel, settings: EvaluationSettings
) -> bool:
    """Whether a pose is wrong only by a turn that nearly maps the object onto itself.

    It is turned by more than the refiner's basin, and yet its ADD-S is small. Always False for
    objects that the policy calls symmetric: their turned poses are right.
    """
    if settings.is_symmetric(model):
        return False
    bounds = settings.waterfall
    if errors.rotation_error(pose, true) <= np.deg2rad(bounds.basin_deg):
        return False
    vertices = np.asarray(model.mesh.vertices, dtype=np.float64)
    return errors.add_s(pose, true, vertices) < bounds.flip_fraction * model.diameter


def _symmetries(model: ObjectModel, settings: EvaluationSettings) -> Float[np.ndarray, "s 4 4"]:
    return model.symmetries if settings.is_symmetric(model) else np.eye(4)[None]
