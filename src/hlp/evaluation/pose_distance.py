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
    """Votes for one object in one frame: how many, how many good, and the weight of both.

    `cast_by_object` counts those of patches on the visible object, `good_by_object` the good ones
    of these.
    """

    object_id: int
    votes: int
    good: int
    weight: float
    good_weight: float
    cast_by_object: int
    good_by_object: int


def tally(
    object_id: int,
    good: Bool[np.ndarray, "v"],
    weights: Float[np.ndarray, "v"],
    on_object: Bool[np.ndarray, "v"],
) -> VoteTally:
    """Count votes of which these are good and these were cast by patches on the object."""
    return VoteTally(
        object_id,
        len(good),
        int(good.sum()),
        float(weights.sum()),
        float(weights[good].sum()),
        int(on_object.sum()),
        int((good & on_object).sum()),
    )


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
    return errors.add_s(pose, true, vertices) < bounds.flip_fraction * model.diameter


def votes_quality(tallies: Iterable[VoteTally], names: Mapping[int, str]) -> dict[str, Any]:
    """Share of good votes, over all votes and per object; `votes` is their mean number a target.

    `good_weight` is the share of the weight; `by_object` of the votes that patches on the object
    cast (the others are the region's fault), and `good_by_object` of the good ones among these (the
    features'). None where there is no vote.
    """
    groups: dict[str, list[VoteTally]] = {}
    for each in sorted(tallies, key=lambda item: item.object_id):
        groups.setdefault(names[each.object_id], []).append(each)
    everything = [each for group in groups.values() for each in group]
    per_object = {name: _quality(group) for name, group in groups.items()}
    return {"total": _quality(everything), "per_object": per_object}


def _quality(tallies: list[VoteTally]) -> dict[str, float | None]:
    votes = sum(each.votes for each in tallies)
    weight = sum(each.weight for each in tallies)
    cast = sum(each.cast_by_object for each in tallies)
    return {
        "good": _ratio(sum(each.good for each in tallies), votes),
        "good_weight": _ratio(sum(each.good_weight for each in tallies), weight),
        "by_object": _ratio(cast, votes),
        "good_by_object": _ratio(sum(each.good_by_object for each in tallies), cast),
        "votes": _ratio(votes, len(tallies)),
    }


def _ratio(part: float, whole: float) -> float | None:
    return part / whole if whole else None


def _symmetries(model: ObjectModel, settings: EvaluationSettings) -> Float[np.ndarray, "s 4 4"]:
    return model.symmetries if model.name in settings.symmetric else np.eye(4)[None]
