"""Fine pose by iterative closest points, point to plane (Chen & Medioni 1992).

The alternative that the paper compares PSO with: one least-squares step per iteration instead of a
search. The model's visible surface points come from a rendering at the current pose.
"""

from dataclasses import dataclass, field
from typing import Annotated, Literal

import cv2
import numpy as np
from annotated_types import Ge, Le

from hlp.arrays import Points, Pose
from hlp.geometry import rigid, transform
from hlp.records import MILLIMETRES_PER_METRE, Hypotheses, ObjectModel, Refinement
from hlp.refinement.cost import CostSettings, DepthCost
from hlp.refinement.refiner import REFINERS, Refiner, cost_around
from hlp.refinement.verification import Observation, VerificationSettings
from hlp.rendering.surface import surface_and_normals
from hlp.settings import Count, Doc, NotNegative, Positive, Settings, Share


@REFINERS.register
@dataclass(frozen=True)
class IcpSettings(Settings):
    """Config group `refinement`: iterative closest points, point to plane. All ours (D)."""

    name: Literal["icp"] = "icp"
    cost: CostSettings = field(default_factory=CostSettings)
    verification: VerificationSettings = field(default_factory=VerificationSettings)
    iterations: Annotated[int, Ge(1), Le(10_000), Doc("largest number of iterations (D)")] = 20
    points: Annotated[Count, Doc("approximate number of points on the rendered surface (D)")] = 500
    max_correspondence_mm: Annotated[
        Positive, Doc("pairs farther apart are ignored in the first iteration … (D)")
    ] = 40.0
    final_max_correspondence_mm: Annotated[Positive, Doc("… and in the last (D)")] = 10.0
    trim: Annotated[
        Share, Doc("fraction of the pairs, the closest, that is used; this excludes occluders (D)")
    ] = 0.8
    converged_mm: Annotated[NotNegative, Doc("stop when no point moves farther (D)")] = 0.05

    def build(self, threads: int) -> "IcpRefiner":
        """The refiner; it uses one thread."""
        return IcpRefiner(self)


class IcpRefiner(Refiner):
    """Point-to-plane ICP of the rendered surface against the observed points around it."""

    def __init__(self, settings: IcpSettings) -> None:
        self._settings = settings

    def refine(
        self,
        model: ObjectModel,
        observation: Observation,
        hypotheses: Hypotheses,
        seed: int,
        spent: float = 0.0,
    ) -> list[Refinement]:
        """See `Refiner.refine`. `seed` and `spent` are not used: nothing is random or timed."""
        refined = []
        for pose in hypotheses.poses_cam_obj:
            cost = cost_around(model, observation, pose, self._settings.cost)
            best, iterations = align(cost, pose, self._settings)
            refined.append(Refinement(best, iterations))
        return refined


def align(cost: DepthCost, pose_cam_obj: Pose, settings: IcpSettings) -> tuple[Pose, int]:
    """Aligned pose and the number of steps taken; the given pose if nothing can be matched.

    Correspondences farther apart than a limit are ignored. The limit shrinks geometrically from
    `max_correspondence_mm` to `final_max_correspondence_mm`. Of the remaining correspondences the
    closest share `trim` is used.
    """
    from scipy.spatial import cKDTree

    pose = np.array(pose_cam_obj, dtype=np.float64)
    seen = cost.observed > 0.0
    observed, _ = surface_and_normals(
        cost.observed, seen, int(np.count_nonzero(seen)), cost.camera_matrix
    )
    if len(observed) == 0:
        return pose, 0
    tree = cKDTree(observed)
    first, last = settings.max_correspondence_mm, settings.final_max_correspondence_mm
    limits = np.geomspace(first, last, settings.iterations) / MILLIMETRES_PER_METRE
    for iteration, limit in enumerate(limits):
        points, normals = _surface(cost, pose, settings.points)
        distances, indices = tree.query(points, distance_upper_bound=limit)
        near = np.flatnonzero(np.isfinite(distances))
        near = near[np.argsort(distances[near], kind="stable")][: int(settings.trim * len(near))]
        if len(near) < 6:
            return pose, iteration
        step = _step(points[near], normals[near], observed[indices[near]])
        pose = step @ pose
        displacements = np.linalg.norm(transform(step, points[near]) - points[near], axis=1)
        if (
            displacements.max() < settings.converged_mm / MILLIMETRES_PER_METRE
            and limit == limits[-1]
        ):
            break
    return pose, iteration + 1


def _surface(cost: DepthCost, pose_cam_obj: Pose, count: int) -> tuple[Points, Points]:
    """About `count` visible points of the model, spread evenly in the image, and unit normals."""
    rendered = cost.render(pose_cam_obj)
    cross = cv2.getStructuringElement(cv2.MORPH_CROSS, (3, 3))
    inside = cv2.erode((rendered > 0.0).view(np.uint8), cross) > 0
    points, normals = surface_and_normals(
        rendered, inside, int(np.count_nonzero(inside)), cost.camera_matrix
    )
    keep = np.flatnonzero(normals.any(axis=1))
    keep = keep[:: max(len(keep) // count, 1)]
    return points[keep], normals[keep]


def _step(points: Points, normals: Points, targets: Points) -> Pose:
    """Motion (R, t) that minimises Σ (n · (R p + t − target))², linearised about the mean of p.

    Motions that the surface does not constrain, such as a sphere's rotations, are left out.
    """
    from scipy.spatial.transform import Rotation

    middle = points.mean(axis=0)
    jacobian = np.concatenate([np.cross(points - middle, normals), normals], axis=1)
    residual = np.einsum("ij,ij->i", normals, targets - points)
    solution = np.linalg.lstsq(jacobian, residual, rcond=1e-4)[0]
    rotation = Rotation.from_rotvec(solution[:3]).as_matrix()
    return rigid(rotation, middle + solution[3:] - rotation @ middle)
