"""How near poses and votes come to the truth, up to the object's symmetries. Metres, degrees."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Bool, Float

from hlp.evaluation import errors
from hlp.evaluation.settings import EvaluationSettings
from hlp.geometry import transform
from hlp.records import ObjectModel

Pose = Float[np.ndarray, "4 4"]


@dataclass(frozen=True)
class VoteTally:
    """Votes for one object in one frame: how many, how many good, and the weight of both."""

    object_id: int
    votes: int
    good: int
    weight: float
    good_weight: float


def near_truth(
    rotations_cam_obj: Float[np.ndarray, "n 3 3"],
    centroids_cam: Float[np.ndarray, "n 3"],
    true: Pose,
    model: ObjectModel,
    settings: EvaluationSettings,
    bounds: tuple[float, float],
) -> Bool[np.ndarray, "n"]:
    """Which rotations and centroids lie within `bounds` (degrees, mm) of the true pose.

    Of a symmetric object, within those of one of the poses that look alike.
    """
    degrees, millimetres = bounds
    alike = true @ _symmetries(model, settings)
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
    """`near_truth` of poses: what turns about the centroid does not move."""
    centroids = transform(poses_cam_obj, model.centroid[None])[:, 0]
    return near_truth(poses_cam_obj[:, :3, :3], centroids, true, model, settings, bounds)


def right_poses(
    poses_cam_obj: Float[np.ndarray, "n 4 4"],
    true: Pose,
    model: ObjectModel,
    settings: EvaluationSettings,
) -> Bool[np.ndarray, "n"]:
    """Which poses are right by AD: ADI for objects that the policy calls symmetric, else ADD."""
    error = errors.adi if model.name in settings.symmetric else errors.add
    vertices = np.asarray(model.mesh.vertices, dtype=np.float64)
    limit = settings.ad_fraction * model.diameter
    return np.array([error(pose, true, vertices) < limit for pose in poses_cam_obj], dtype=bool)


def is_flipped(pose: Pose, true: Pose, model: ObjectModel, settings: EvaluationSettings) -> bool:
    """Whether a wrong pose is right but for a turn that (nearly) maps the object onto itself.

    It is turned by more than the refiner's basin, yet the closest points of both surfaces are near
    (ADI). Never so for objects that the policy calls symmetric: their turned poses are right.
    """
    if model.name in settings.symmetric:
        return False
    bounds = settings.waterfall
    if errors.rotation_error(pose, true) <= np.deg2rad(bounds.basin_deg):
        return False
    vertices = np.asarray(model.mesh.vertices, dtype=np.float64)
    return errors.adi(pose, true, vertices) < bounds.flip_fraction * model.diameter


def votes_quality(tallies: Iterable[VoteTally], names: Mapping[int, str]) -> dict[str, Any]:
    """Share of good votes and of their weight, over all votes and per object.

    None where there is no vote. `votes` is their mean number for one object in one frame.
    """
    groups: dict[str, list[VoteTally]] = {}
    for tally in sorted(tallies, key=lambda each: each.object_id):
        groups.setdefault(names[tally.object_id], []).append(tally)
    everything = [tally for group in groups.values() for tally in group]
    per_object = {name: _quality(group) for name, group in groups.items()}
    return {"total": _quality(everything), "per_object": per_object}


def _quality(tallies: list[VoteTally]) -> dict[str, float | None]:
    votes = sum(tally.votes for tally in tallies)
    weight = sum(tally.weight for tally in tallies)
    good = sum(tally.good for tally in tallies)
    good_weight = sum(tally.good_weight for tally in tallies)
    return {
        "good": good / votes if votes else None,
        "good_weight": good_weight / weight if weight else None,
        "votes": votes / len(tallies) if tallies else None,
    }


def _symmetries(model: ObjectModel, settings: EvaluationSettings) -> Float[np.ndarray, "s 4 4"]:
    return model.symmetries if model.name in settings.symmetric else np.eye(4)[None]
