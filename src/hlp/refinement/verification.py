"""Cost of a pose on its own: which of several hypotheses is right, and how sure is it.

The search's cost (Eq. 2) is relative to a coarse pose and shaped to pull. This one compares poses
that come from anywhere. Beside depth and edgelets it looks at colour: where an object's surface is
seen it has the model's colours, of which only the chromaticity is compared, since brightness is
the light's.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Float, Float32, UInt8

from hlp.geometry import transform
from hlp.records import ObjectModel
from hlp.refinement.cost_kernel import WORST, depth_edges
from hlp.refinement.verification_kernel import FLOOR, SUMS, sum_evidence
from hlp.rendering.zbuffer import prepared

_LEAST_SUPPORT, _LEAST_SHARE = 1e-12, 0.01


@dataclass(frozen=True)
class VerificationSettings:
    """Settings; see conf/refinement/verification/hlp.yaml for what each means."""

    candidates: int
    max_improvement: float
    weight_depth: float
    weight_edge: float
    weight_color: float
    tau_depth_mm: float
    tau_edge_mm: float
    tau_color: float
    edge_step_mm: float
    missing_cost: float
    occlusion_cost: float
    occlusion_share_cost: float
    occluded_edge_cost: float
    unexplained_cost: float
    support_cost: float
    roi_size: int


@dataclass(frozen=True)
class Evidence:
    """What an image says about n poses, in shares of the rendered pixels (edges: edgelets).

    `residual` is the mean of |S − O| / τ_d where it is below 1, counted over all pixels; `behind`
    shows a surface beyond the object, `occluded` one before it, `missing` no depth (1 as well where
    nothing is rendered). `color` is the mean of min(|Δ chromaticity|₁, τ_c) / τ_c where depth
    agrees. `edge` is the mean distance to O's closest edgelet over τ_e where the edgelet is not
    occluded, `edges_occluded` the occluded share. `area` is what agrees, in the image's pixels.
    """

    area: Float[np.ndarray, "n"]
    residual: Float[np.ndarray, "n"]
    behind: Float[np.ndarray, "n"]
    occluded: Float[np.ndarray, "n"]
    missing: Float[np.ndarray, "n"]
    color: Float[np.ndarray, "n"]
    edge: Float[np.ndarray, "n"]
    edges_occluded: Float[np.ndarray, "n"]


@dataclass(frozen=True)
class Observation:
    """What poses of any object are compared with: a frame, and its distances to edgelets (px)."""

    rgb: UInt8[np.ndarray, "h w 3"]
    depth: Float32[np.ndarray, "h w"]
    camera_matrix: Float[np.ndarray, "3 3"]
    edge_distance: Float32[np.ndarray, "h w"]


def observe(
    rgb: UInt8[np.ndarray, "h w 3"],
    depth: Float[np.ndarray, "h w"],
    camera_matrix: Float[np.ndarray, "3 3"],
    settings: VerificationSettings,
) -> Observation:
    """Prepare a frame, once for all poses and objects; depth in m, 0 or not finite = missing."""
    single = np.ascontiguousarray(depth, dtype=np.float32)
    smooth = ~depth_edges(single, settings.edge_step_mm / 1000.0)
    # Approximate, but by 2 % at most, and in a quarter of the exact one's time.
    distance = cv2.distanceTransform(smooth.view(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_5)
    if smooth.all():
        distance = np.full(depth.shape, np.inf)
    return Observation(
        np.ascontiguousarray(rgb),
        single,
        np.asarray(camera_matrix),
        np.asarray(distance, dtype=np.float32),
    )


class Verifier:
    """Verification cost of poses of one object."""

    def __init__(self, model: ObjectModel, settings: VerificationSettings) -> None:
        mesh = model.proxy
        self._settings = settings
        self._centroid, self._radius = model.centroid, model.diameter / 2.0
        self._vertices, self._faces, self._closed = prepared(mesh)
        raised = mesh.colors[mesh.faces].mean(axis=1) + FLOOR
        shares = raised / raised.sum(axis=1, keepdims=True)
        self._chromaticity = shares.astype(np.float32)

    def costs(
        self, observation: Observation, poses_cam_obj: Float[np.ndarray, "n 4 4"]
    ) -> Float[np.ndarray, "n"]:
        """Cost in [0, 1] of each pose, lower is better; comparable between poses of one object."""
        return self.weigh(self.evidence(observation, poses_cam_obj))

    def competing_costs(
        self,
        observation: Observation,
        poses_cam_obj: Float[np.ndarray, "n 4 4"],
        support: Float[np.ndarray, "n"],
    ) -> Float[np.ndarray, "n"]:
        """Cost in [0, 1] of each pose beside the others.

        A mean over what a pose shows favours poses that show little. So a pose pays for what it
        leaves unexplained: the share by which its agreeing area falls short of the largest among
        the poses at its place, whose centroids are within half a diameter. It pays as well for few
        votes, by the logarithm of the largest `support` over its own, as votes are evidence too.
        """
        found = self.evidence(observation, poses_cam_obj)
        centers = transform(poses_cam_obj, self._centroid[None])[:, 0]
        apart = np.linalg.norm(centers[:, None] - centers, axis=-1)
        largest = np.where(apart < self._radius, found.area, 0.0).max(axis=1, initial=1.0)
        costs = self.weigh(found) + self._settings.unexplained_cost * (1.0 - found.area / largest)
        share = support / max(float(support.max(initial=0.0)), _LEAST_SUPPORT)
        costs -= self._settings.support_cost * np.log(np.maximum(share, _LEAST_SHARE))
        return np.asarray(np.minimum(costs, WORST))

    def weigh(self, evidence: Evidence) -> Float[np.ndarray, "n"]:
        """Cost of what was seen; the worst where that is no depth at all.

        A occluded pixel costs more, the more of the object is occluded: right poses may be half
        occluded, but one that hides almost wholly is hardly believed.
        """
        settings = self._settings
        price = settings.occlusion_cost + settings.occlusion_share_cost * evidence.occluded
        depth = evidence.residual + evidence.behind
        depth += price * evidence.occluded + settings.missing_cost * evidence.missing
        edge = (1.0 - evidence.edges_occluded) * evidence.edge
        edge += settings.occluded_edge_cost * evidence.edges_occluded
        parts = settings.weight_depth * depth + settings.weight_edge * edge
        parts += settings.weight_color * evidence.color
        whole = settings.weight_depth + settings.weight_edge + settings.weight_color
        return np.where(evidence.missing < 1.0, np.clip(parts / whole, 0.0, 1.0), WORST)

    def evidence(
        self, observation: Observation, poses_cam_obj: Float[np.ndarray, "n 4 4"]
    ) -> Evidence:
        """What the image says about each pose."""
        settings = self._settings
        sums = np.empty((len(poses_cam_obj), SUMS))
        sum_evidence(
            np.ascontiguousarray(poses_cam_obj, dtype=np.float64),
            self._vertices,
            self._faces,
            self._closed,
            self._chromaticity,
            observation.camera_matrix,
            settings.roi_size,
            observation.depth,
            observation.rgb,
            observation.edge_distance,
            settings.tau_depth_mm / 1000.0,
            settings.tau_edge_mm / 1000.0,
            settings.tau_color,
            settings.edge_step_mm / 1000.0,
            sums,
        )
        return _in_shares(sums)


def _in_shares(sums: Float[np.ndarray, "n 11"]) -> Evidence:
    pixels, agreeing, behind, occluded, missing, edges, edges_occluded = sums.T[:7]
    residual, color, edge, size = sums.T[7:]
    per_pixel = 1.0 / np.maximum(pixels, 1.0)
    seen_edges = edges - edges_occluded
    return Evidence(
        agreeing * size,
        residual * per_pixel,
        behind * per_pixel,
        occluded * per_pixel,
        np.where(pixels > missing, missing * per_pixel, 1.0),
        np.where(agreeing > 0.0, color / np.maximum(agreeing, 1.0), 1.0),
        np.where(seen_edges > 0.0, edge / np.maximum(seen_edges, 1.0), 1.0),
        edges_occluded / np.maximum(edges, 1.0),
    )
