"""Iterative closest points, point to plane (Chen & Medioni 1992).

Coarse poses of objects without colours are aligned so; as a refiner it is the alternative that the
paper compares PSO with. Points are paired by projection, and all poses take a step at once.
"""

from dataclasses import dataclass, field
from typing import Annotated, Literal

import numpy as np
from annotated_types import Le
from jaxtyping import Float, Float32

from hlp.arrays import CameraMatrix, Points, Poses, Values
from hlp.geometry import rigid, rotation_matrices, transform
from hlp.kernels import compiled_ahead
from hlp.records import MILLIMETRES_PER_METRE, Hypotheses, ObjectModel
from hlp.refinement.refiner import REFINERS, IsHopeless, Refinement, Refiner
from hlp.refinement.verification import Observation, VerificationSettings
from hlp.rendering.surface import sample_surface
from hlp.settings import Count, Doc, Positive, Settings

_COARSE = np.array([0.12, 0.10, 0.08, 0.05, 0.03])  # of the diameter (D)
_SOFT = 0.3  # of a limit: a pair as far apart counts half (Cauchy)
_ROTATION, _TRANSLATION = 1e-3, 1e-2  # damping, so that nothing slides along a plane
_SLANT = 0.2  # cosine: surfaces that face the camera less are left out
_NEAREST = 0.05  # m


@REFINERS.register
@dataclass(frozen=True)
class IcpSettings(Settings):
    """Config group `refinement`: iterative closest points, point to plane. All ours (D)."""

    name: Literal["icp"] = "icp"
    verification: VerificationSettings = field(default_factory=VerificationSettings)
    iterations: Annotated[Count, Le(10_000), Doc("number of iterations (D)")] = 20
    points: Annotated[Count, Doc("number of points on the model's surface (D)")] = 500
    max_correspondence_mm: Annotated[
        Positive, Doc("pairs farther apart are ignored in the first iteration … (D)")
    ] = 40.0
    final_max_correspondence_mm: Annotated[Positive, Doc("… and in the last (D)")] = 10.0

    def build(self, threads: int) -> "IcpRefiner":
        """The refiner; it uses one thread."""
        return IcpRefiner(self)


class IcpRefiner(Refiner):
    """Point-to-plane ICP of the model's surface against the points seen at its pixels."""

    def __init__(self, settings: IcpSettings) -> None:
        self._settings = settings

    def refine(
        self,
        model: ObjectModel,
        observation: Observation,
        hypotheses: Hypotheses,
        seed: int,
        spent: float = 0.0,
        is_hopeless: IsHopeless | None = None,
    ) -> list[Refinement]:
        """See `Refiner.refine`. Nothing is random or timed, and all poses take the same steps."""
        settings = self._settings
        ends = settings.max_correspondence_mm, settings.final_max_correspondence_mm
        limits = np.geomspace(*ends, settings.iterations) / MILLIMETRES_PER_METRE
        poses = align_to_depth(
            hypotheses.poses_cam_obj, model, observation, limits, settings.points
        )
        return [Refinement(pose, settings.iterations) for pose in poses]


def align_to_depth(
    poses_cam_obj: Poses,
    model: ObjectModel,
    seen: Observation,
    limits: Values | None = None,
    count: int = 150,
) -> Poses:
    """Poses that fit the observed depth, near those given; without anything near, the same.

    Each step minimises the distances between `count` points of the model, of which those that face
    the camera matter, and planes with the model's normals through the points that are seen at their
    pixels. `limits` has one distance (m) for each step: pairs farther apart are left out; None: for
    coarse poses, whose costs would else mostly tell how coarse they are.
    """
    limits = _COARSE * model.diameter if limits is None else limits
    surface = sample_surface(model.proxy, count)
    points = surface.points - model.centroid
    rotations = np.ascontiguousarray(poses_cam_obj[:, :3, :3])
    centers = transform(poses_cam_obj, model.centroid[None])[:, 0]
    damping = np.diag(np.repeat([_ROTATION * model.diameter**2, _TRANSLATION], 3))
    for limit in limits:
        image = seen.depth, seen.camera_matrix, limit
        sums = _sum_products(rotations, centers, points, surface.normals, *image)
        paired = np.trace(sums[:, 3:6, 3:6], axis1=1, axis2=2)  # the normals' lengths are 1
        products = sums[:, :6, :6] + np.maximum(paired, 1.0)[:, None, None] * damping
        step = np.linalg.solve(products, sums[:, :6, 6:])[..., 0]
        half_turns = np.concatenate([step[:, :3] / 2.0, np.ones((len(step), 1))], axis=1)
        rotations, centers = rotation_matrices(half_turns) @ rotations, centers + step[:, 3:]
    return rigid(rotations, centers - rotations @ model.centroid)


@compiled_ahead(error_model="numpy")
def _sum_products(
    rotations: Float[np.ndarray, "n 3 3"],
    centers: Points,
    points: Points,
    normals: Points,
    depth: Float32[np.ndarray, "h w"],
    camera_matrix: CameraMatrix,
    limit: float,
) -> Float[np.ndarray, "n 7 7"]:
    """Weighted sums over pairs of v·vᵀ, v: a step's six effects on a distance, and the distance."""
    fx, fy = camera_matrix[0, 0], camera_matrix[1, 1]
    cx, cy = camera_matrix[0, 2], camera_matrix[1, 2]
    sums = np.zeros((len(centers), 7, 7))
    arm, normal, effects = np.empty(3), np.empty(3), np.empty(7)
    for n in range(len(centers)):
        for k in range(len(points)):
            for i in range(3):
                arm[i], normal[i] = 0.0, 0.0
                for j in range(3):
                    arm[i] += rotations[n, i, j] * points[k, j]
                    normal[i] += rotations[n, i, j] * normals[k, j]
            x, y, z = centers[n, 0] + arm[0], centers[n, 1] + arm[1], centers[n, 2] + arm[2]
            facing = normal[0] * x + normal[1] * y + normal[2] * z
            if z < _NEAREST or facing > -_SLANT * np.sqrt(x * x + y * y + z * z):
                continue
            u, v = int(np.floor(fx * x / z + cx + 0.5)), int(np.floor(fy * y / z + cy + 0.5))
            inside = 0 <= u < depth.shape[1] and 0 <= v < depth.shape[0]
            if not inside or not abs(depth[v, u] - z) <= limit:  # NaN, too
                continue
            seen = depth[v, u]
            effects[6] = normal[0] * ((u - cx) / fx * seen - x)
            effects[6] += normal[1] * ((v - cy) / fy * seen - y) + normal[2] * (seen - z)
            for i in range(3):
                effects[i] = arm[i - 2] * normal[i - 1] - arm[i - 1] * normal[i - 2]
                effects[3 + i] = normal[i]
            weight = 1.0 / (1.0 + (effects[6] / (_SOFT * limit)) ** 2)
            for i in range(7):
                for j in range(7):
                    sums[n, i, j] += weight * effects[i] * effects[j]
    return sums
