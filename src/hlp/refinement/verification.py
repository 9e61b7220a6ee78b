"""Verification cost: which of several hypotheses is right, and how certain it is.

The cost that the refiner minimises (Eq. 2) depends on the coarse pose. This cost compares poses
from any source. In addition to depth and depth edges, it uses colour: the visible surface should
have the model's chromaticity. Brightness is ignored, since it depends on the light.
"""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Annotated, NamedTuple

import cv2
import numpy as np
from annotated_types import Le, Unit
from jaxtyping import Float32, Int8

from hlp.arrays import CameraMatrix, Flags, Image, Mask, Pose, Poses, Rgb, Values
from hlp.geometry import transform
from hlp.image_edges import NO_EDGE, STEPS, color_edges
from hlp.records import ObjectModel
from hlp.refinement.cost_kernel import WORST, depth_edges
from hlp.refinement.object_depth import ObjectDepth
from hlp.refinement.turns import half_turns, turns_about_axis
from hlp.refinement.verification_kernel import COLOR_OFFSET, SeenImages, Tolerances, sum_evidence
from hlp.rendering.zbuffer import DIRECTIONS, prepare_mesh
from hlp.settings import Count, Doc, NotNegative, Positive, PositiveOrNone, Settings

_DRAWN = 500  # depths of objects that are kept: some 20 MB
_NEAR_DIRECTION = 3  # 16ths of half a turn
_MIN_SUPPORT, _MIN_SHARE = 1e-12, 0.01  # keep the logarithm of the support finite


@dataclass(frozen=True)
class VerificationSettings(Settings):
    """Cost that ranks coarse poses before refinement and chooses among the refined ones."""

    candidates: Annotated[
        Count,
        Le(10_000),
        Doc("largest number of coarse poses that are refined, those of least cost (D)"),
    ] = 16
    max_improvement: Annotated[
        NotNegative,
        Doc("coarse poses that cost more than the best refined one plus this are not refined (D)"),
    ] = 0.1
    weight_depth: Annotated[
        NotNegative,
        Doc("as in the search's cost (P: Eq. 2); only the ratios of the three weights count"),
    ] = 0.8
    weight_edge: Annotated[
        NotNegative, Doc("poses sunk into a table have right depth and wrong edges (D; P: 0.2)")
    ] = 0.3
    weight_color: Annotated[
        NotNegative, Doc("chromaticity distinguishes things of the same shape (D; P: 0)")
    ] = 0.2
    tau_depth_mm: Annotated[
        Positive, Doc("limit of depth differences; narrower than in the search, to judge poses (D)")
    ] = 20.0
    tau_edge_mm: Annotated[Positive, Doc("limit of the distances of edgelets (D)")] = 15.0
    tau_color: Annotated[
        Positive, Doc("limit of chromaticity differences, |Δr| + |Δg| + |Δb| (D)")
    ] = 0.3
    tau_image_edge_mm: Annotated[
        PositiveOrNone,
        Doc(
            "limit of distances to colour edges, of objects without colours; null: depth alone (D)"
        ),
    ] = 10.0
    edge_step_mm: Annotated[Positive, Doc("smallest jump in depth that is an edge (D)")] = 15.0
    missing_cost: Annotated[
        NotNegative, Doc("cost of a rendered pixel where no depth was observed (D)")
    ] = 0.3
    occluder_cost: Annotated[
        NotNegative, Doc("cost of an occluded pixel; right poses may be half hidden (D; P: 1)")
    ] = 0.1
    occluder_share_cost: Annotated[
        NotNegative,
        Doc("added to it, times the hidden fraction: few objects are mostly hidden (D; P: 0)"),
    ] = 0.2
    occluded_edge_cost: Annotated[NotNegative, Doc("cost of an occluded edgelet (D; P: 1)")] = 0.5
    unexplained_cost: Annotated[
        NotNegative,
        Doc("weight of pixels that only other poses at the same place explain (D; P: 0)"),
    ] = 0.2
    support_cost: Annotated[
        NotNegative, Doc("weight of ln(largest support by votes / own support) (D; P: 0)")
    ] = 0.01
    roi_size: Annotated[
        Count, Le(2048), Unit("px"), Doc("long side of the compared region (D)")
    ] = 64


class Evidence(NamedTuple):
    """How an image agrees with each of n poses.

    Of the rendered pixels, `behind` is the share where the observed surface is behind the object by
    more than τ_d, `occluded` the share where it is in front of it, `missing` the share without
    observed depth (1 if nothing is rendered). `residual` sums |S − O| / τ_d over the agreeing
    pixels, those with |S − O| ≤ τ_d, divided by the number of rendered pixels. `color` is the mean
    of min(|Δ chromaticity|₁, τ_c) / τ_c over the agreeing pixels. `edges_occluded` is the occluded
    share of the rendered edgelets, `edge` the mean distance of the others to the closest observed
    edgelet, in units of τ_e and at most 1. `area` is the number of agreeing pixels of the image.
    """

    area: Values
    residual: Values
    behind: Values
    occluded: Values
    missing: Values
    color: Values
    edge: Values
    edges_occluded: Values


@dataclass(frozen=True)
class Observation:
    """A frame prepared for verification.

    `edge_distance` is each pixel's distance (px) to what may be an edge whose gradient has a
    direction of 0°, 45°, 90° or 135°: the nearest edgelet of depth, whatever its direction, or the
    nearest edge of colour, whose distance counts in units of its own limit; None where edges of
    colour are not looked for. For `depth_edge_distance` depth alone counts. `drawn` are the depths
    of objects that were drawn last, by verifier and the pose's bytes: most are needed again.
    """

    rgb: Rgb
    depth: Image
    camera_matrix: CameraMatrix
    edge_distance: Float32[np.ndarray, "4 h w"] | None
    depth_edge_distance: Float32[np.ndarray, "4 h w"]
    drawn: dict[tuple["Verifier", bytes], ObjectDepth] = field(default_factory=dict, repr=False)

    def edges_of(self, model: ObjectModel) -> Float32[np.ndarray, "4 h w"] | None:
        """Distances to edges of depth or colour; None for objects with colours, which tell more."""
        return None if model.mesh.colored else self.edge_distance


def observe(
    rgb: Rgb,
    depth: Image,
    camera_matrix: CameraMatrix,
    settings: VerificationSettings,
    find_edges: Callable[[Rgb], Int8[np.ndarray, "h w"]] = color_edges,
) -> Observation:
    """Prepare a frame once for all poses and objects; depth in m, missing if 0 or not finite.

    `find_edges` is asked for the image's edges of colour, if they are needed.
    """
    single = np.ascontiguousarray(depth, dtype=np.float32)
    distance = _distances(depth_edges(single.astype(np.float64), settings.edge_step_mm / 1000.0))
    of_depth, distances = np.repeat(distance[None], DIRECTIONS, axis=0), None
    if settings.tau_image_edge_mm is not None:
        ratio = np.float32(settings.tau_edge_mm / settings.tau_image_edge_mm)
        # An edge may be of each of the kernel's directions that is at most 34° off.
        away = (np.arange(STEPS) - np.arange(0, STEPS, STEPS // DIRECTIONS)[:, None]) % STEPS
        near, edges = np.minimum(away, STEPS - away) <= _NEAR_DIRECTION, find_edges(rgb)
        of_color = [ratio * _distances((edges != NO_EDGE) & among[edges]) for among in near]
        distances = np.minimum(distance, np.stack(of_color))
    return Observation(
        np.ascontiguousarray(rgb), single, np.asarray(camera_matrix), distances, of_depth
    )


def _distances(edges: Mask) -> Image:
    """Distance (px) to the nearest edge, infinite if there is none.

    Up to 2 % off, in a quarter of the time of exact distances.
    """
    if not edges.any():
        return np.full(edges.shape, np.inf, dtype=np.float32)
    distance = cv2.distanceTransform((~edges).view(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_5)
    return np.asarray(distance, dtype=np.float32)


class Verifier:
    """Verification cost of poses of one object.

    Colour takes no part for an object whose mesh has none: the other weights share its weight.
    """

    def __init__(self, model: ObjectModel, settings: VerificationSettings) -> None:
        self.settings, self.model, self.mesh = settings, model, model.proxy
        self._kernel_mesh = prepare_mesh(self.mesh)
        self.tau_depth = settings.tau_depth_mm / 1000.0  # m
        self._limits = Tolerances(
            self.tau_depth,
            settings.tau_edge_mm / 1000.0,
            settings.tau_color,
            settings.edge_step_mm / 1000.0,
        )
        # The colours of a mesh without colours mean nothing.
        self._weight_color = settings.weight_color if model.mesh.colored else 0.0
        offset_colors = self.mesh.colors[self.mesh.faces].mean(axis=1) + COLOR_OFFSET
        chromaticity = offset_colors / offset_colors.sum(axis=1, keepdims=True)
        self._chromaticity = chromaticity.astype(np.float32)

    @cached_property
    def turns(self) -> Poses:
        """Turns (n, 4, 4) after which the object looks much alike, see `turns_about_axis`."""
        return turns_about_axis(self.model)

    @cached_property
    def half_turns(self) -> Poses:
        """Turns (n, 4, 4) after which a part without colours may look alike, see `half_turns`."""
        return half_turns(self.model)

    def costs(self, observation: Observation, poses_cam_obj: Poses) -> Values:
        """Cost in [0, 1] of each pose, lower is better; comparable between poses of one object."""
        return self.weigh(self.evidence(observation, poses_cam_obj))

    def competing_costs(self, found: Evidence, poses_cam_obj: Poses, support: Values) -> Values:
        """Cost in [0, 1] of each pose, of which this was `found`, in competition with the others.

        Means over the rendered pixels favour poses in which little of the object is visible. So a
        pose pays for the share by which its agreeing area is smaller than the largest area among
        the poses at the same place (centroids less than half a diameter apart). It also pays for
        the logarithm of the largest `support` over its own, because votes are evidence, too.
        """
        centers = transform(poses_cam_obj, self.model.centroid[None])[:, 0]
        distances = np.linalg.norm(centers[:, None] - centers, axis=-1)
        near = distances < self.model.diameter / 2.0
        largest = np.where(near, found.area, 0.0).max(axis=1, initial=1.0)
        costs = self.weigh(found) + self.settings.unexplained_cost * (1.0 - found.area / largest)
        share = support / max(float(support.max(initial=0.0)), _MIN_SUPPORT)
        costs -= self.settings.support_cost * np.log(np.maximum(share, _MIN_SHARE))
        return np.asarray(np.minimum(costs, WORST))

    def depth_of(self, observation: Observation, pose_cam_obj: Pose) -> ObjectDepth:
        """The object's depth at a pose, in the image of an observation."""
        known, key = observation.drawn, (self, pose_cam_obj.tobytes())
        if (found := known.get(key)) is None:
            if len(known) >= _DRAWN:
                known.clear()
            (height, width), camera = observation.depth.shape, observation.camera_matrix
            found = known[key] = ObjectDepth.of(self.mesh, pose_cam_obj, camera, (height, width))
        return found

    def without_explained(self, observation: Observation, pose_cam_obj: Pose) -> Observation:
        """The image without depth where the object at this pose explains it, up to τ_d."""
        drawn, depth = self.depth_of(observation, pose_cam_obj), observation.depth.copy()
        drawn.part(depth)[drawn.explains(depth, self.tau_depth)] = 0.0
        return replace(observation, depth=depth)

    def is_free(self, unexplained: Observation, poses_cam_obj: Poses, evidence: Evidence) -> Flags:
        """Whether more than half of the pixels that agree with each pose are still unexplained.

        `evidence` is that of the whole image, `unexplained` is made by `without_explained`.
        """
        left = self.evidence(unexplained, poses_cam_obj)
        return np.asarray(2.0 * left.area > evidence.area)

    def weigh(self, evidence: Evidence) -> Values:
        """Cost in [0, 1] of the evidence for each pose; `WORST` if there is no depth at all.

        An occluded pixel costs more, the more of the object is occluded: correct poses may be half
        occluded, but poses that are almost completely occluded are rarely correct.
        """
        settings = self.settings
        pixel_cost = settings.occluder_cost + settings.occluder_share_cost * evidence.occluded
        depth = evidence.residual + evidence.behind
        depth += pixel_cost * evidence.occluded + settings.missing_cost * evidence.missing
        edge = (1.0 - evidence.edges_occluded) * evidence.edge
        edge += settings.occluded_edge_cost * evidence.edges_occluded
        weighted = settings.weight_depth * depth + settings.weight_edge * edge
        weighted += self._weight_color * evidence.color
        total_weight = settings.weight_depth + settings.weight_edge + self._weight_color
        return np.where(evidence.missing < 1.0, np.clip(weighted / total_weight, 0.0, 1.0), WORST)

    def evidence(self, observation: Observation, poses_cam_obj: Poses) -> Evidence:
        """How the image agrees with each pose."""
        edges = observation.edges_of(self.model)
        edges = observation.depth_edge_distance if edges is None else edges
        sums = sum_evidence(
            np.ascontiguousarray(poses_cam_obj, dtype=np.float64),
            self._kernel_mesh,
            self._chromaticity,
            observation.camera_matrix,
            SeenImages(observation.depth, observation.rgb, edges),
            self._limits,
            self.settings.roi_size,
        )
        # The order in which `verification_kernel` fills the sums.
        pixels, agreeing, behind, occluded, missing, edgelets, edgelets_occluded = sums.T[:7]
        residual, color, edge, size = sums.T[7:]
        per_pixel = 1.0 / np.maximum(pixels, 1.0)
        seen_edges = edgelets - edgelets_occluded
        return Evidence(
            agreeing * size,
            residual * per_pixel,
            behind * per_pixel,
            occluded * per_pixel,
            np.where(pixels > missing, missing * per_pixel, 1.0),
            np.where(agreeing > 0.0, color / np.maximum(agreeing, 1.0), 1.0),
            np.where(seen_edges > 0.0, edge / np.maximum(seen_edges, 1.0), 1.0),
            edgelets_occluded / np.maximum(edgelets, 1.0),
        )
