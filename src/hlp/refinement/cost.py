"""Cost of a pose: rendered depth S against observed depth O (paper, section 3.3, Eq. 2).

cost(S, O) = w_d · C_d + w_e · C_e, both in [0, 1], over a region of interest (ROI) around the
coarse pose. The ROI is resampled to a bounded size, so that all objects take about the same time.
One compiled kernel transforms the mesh, draws it into a z-buffer and sums the cost.
"""

from dataclasses import dataclass
from typing import Annotated

import cv2
import numpy as np
from annotated_types import Le, Unit
from jaxtyping import Float, Float32, Int

from hlp.arrays import CameraMatrix, Image, Mask, Points, Pose, Poses, Rows, Values
from hlp.geometry import project, transform
from hlp.records import Mesh
from hlp.refinement.cost_kernel import (
    Limits,
    RegionImages,
    depth_edges,
    draw_mesh,
    sum_costs,
    weigh,
)
from hlp.rendering.rasterizer import NEAR
from hlp.rendering.zbuffer import add_frame, prepare_mesh
from hlp.settings import Count, Doc, NotNegative, Positive, Settings


@dataclass(frozen=True)
class CostSettings(Settings):
    """Cost of a pose during refinement: w_d · C_d + w_e · C_e (paper, Eq. 2).

    Chosen on perturbed true poses of seven LINEMOD objects in clutter.
    """

    weight_depth: Annotated[NotNegative, Doc("weight w_d of depth (P)")] = 0.8
    weight_edge: Annotated[NotNegative, Doc("weight w_e of edges (P)")] = 0.2
    weight_image_edge: Annotated[
        NotNegative, Doc("weight w_e of an object whose edges the colour image shows too (D)")
    ] = 0.5
    tau_depth_mm: Annotated[
        Positive, Doc("limit of depth differences; larger widens the basin, smaller is precise (D)")
    ] = 30.0
    tau_edge_mm: Annotated[Positive, Doc("limit of the distances of edgelets (D)")] = 15.0
    edge_step_mm: Annotated[Positive, Doc("smallest jump in depth that is an edge (D)")] = 15.0
    missing_cost: Annotated[
        NotNegative, Doc("cost of a rendered pixel where no depth was observed (D)")
    ] = 0.5
    occluder_cost: Annotated[
        NotNegative, Doc("largest cost of an occluded pixel; 0 would favour hidden poses (D; P: 1)")
    ] = 0.5
    uncovered_cost: Annotated[
        NotNegative, Doc("cost of a pixel that only the coarse pose explains (D; P: 0)")
    ] = 1.0
    reference_mm: Annotated[
        NotNegative, Doc("the coarse pose explains pixels whose depth differs by at most this (D)")
    ] = 30.0
    roi_size: Annotated[
        Count,
        Le(2048),
        Unit("px"),
        Doc("long side of the compared region, which is never enlarged (D)"),
    ] = 48
    roi_margin_mm: Annotated[NotNegative, Doc("margin around the coarse pose (D)")] = 30.0


class DepthCost:
    """Cost of poses of one mesh near one coarse pose in one depth image.

    C_d is the mean of min(|S − O|, τ_d) / τ_d over the rendered pixels. A pixel without observed
    depth costs `missing_cost`; one where O is in front of S (an occluder) costs at most
    `occluder_cost`. C_e is the mean distance of S's depth edgelets to the closest edgelet of O, in
    units of τ_e and at most 1.

    A mean over the rendered pixels favours poses in which little of the object is visible.
    Therefore pixels where the coarse pose agreed with O within `reference_mm`, but which the
    candidate does not cover, enter the mean of C_d with `uncovered_cost` (0 turns this off).
    `edge_distance` is that of `verification.Observation`; by default C_e knows depth alone.
    """

    def __init__(
        self,
        mesh: Mesh,
        depth: Image,
        camera_matrix: CameraMatrix,
        pose_cam_obj: Pose,
        settings: CostSettings,
        edge_distance: Float32[np.ndarray, "4 h w"] | None = None,
    ) -> None:
        self._mesh = prepare_mesh(mesh)
        points = transform(pose_cam_obj, mesh.vertices)
        z = max(float(points[:, 2].mean()), NEAR)
        margin = settings.roi_margin_mm / 1000.0 * camera_matrix[0, 0] / z
        rows, columns, self.camera_matrix = _region(
            depth.shape, camera_matrix, points, settings.roi_size, margin
        )
        observed = depth[rows[:, None], columns].astype(np.float64)
        self.observed = np.where(np.isfinite(observed) & (observed > 0.0), observed, 0.0)
        if edge_distance is None:
            distances = edge_distances(self.observed, settings.edge_step_mm / 1000.0)[None]
            focal = self.camera_matrix[0, 0]
        else:
            distances, focal = edge_distance[:, rows[:, None], columns], camera_matrix[0, 0]
        tau_pixels = settings.tau_edge_mm / 1000.0 * focal / z
        edge_costs = [add_frame(image) for image in np.minimum(distances / tau_pixels, 1.0)]
        agreeing = np.zeros(self.observed.shape, dtype=np.bool_)
        if settings.uncovered_cost > 0.0:
            agreeing = self._agreeing(pose_cam_obj, settings.reference_mm / 1000.0)
        self._images = RegionImages(
            add_frame(self.observed), np.stack(edge_costs), add_frame(agreeing)
        )
        self._limits = Limits(
            tau=np.float32(settings.tau_depth_mm / 1000.0),
            step=np.float32(settings.edge_step_mm / 1000.0),
            missing_cost=np.float32(settings.missing_cost),
            occluder_cost=np.float32(settings.occluder_cost),
        )
        agreed = float(np.count_nonzero(agreeing))
        weight_edge = settings.weight_edge if edge_distance is None else settings.weight_image_edge
        self._weights = agreed, settings.weight_depth, weight_edge, settings.uncovered_cost

    def evaluate(self, poses_cam_obj: Poses) -> Values:
        """Cost in [0, 1] of each pose, lower is better."""
        return weigh(self.terms(poses_cam_obj), *self._weights)

    def terms(self, poses_cam_obj: Poses) -> Float[np.ndarray, "n 6"]:
        """Sums from which the cost of each pose is computed.

        Depth costs, rendered pixels, rendered pixels with observed depth, edge costs, edgelets, and
        covered pixels among those where the coarse pose agreed with the observed depth.
        """
        poses = np.asarray(poses_cam_obj, dtype=np.float64)
        return sum_costs(poses, self._mesh, self.camera_matrix, self._images, self._limits)

    def render(self, pose_cam_obj: Pose) -> Image:
        """Depth of the mesh in the ROI (m, 0 = nothing)."""
        pose = np.ascontiguousarray(pose_cam_obj, dtype=np.float64)
        return draw_mesh(pose, self._mesh, self.camera_matrix, *self.observed.shape)

    def _agreeing(self, pose_cam_obj: Pose, tolerance: float) -> Mask:
        rendered = self.render(pose_cam_obj)
        both = (rendered > 0.0) & (self.observed > 0.0)
        return np.asarray(both & (np.abs(rendered - self.observed) <= tolerance))


def edge_distances(depth: Image, step: float) -> Image:
    """Distance (px) of each pixel to the closest edgelet; infinite if there is none."""
    edges = depth_edges(depth, step)
    if not edges.any():
        return np.full(depth.shape, np.inf)
    distance = cv2.distanceTransform((~edges).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    # The last bit of OpenCV's float32 root differs from run to run; its square is an integer.
    return np.asarray(np.sqrt(np.rint(distance.astype(np.float64) ** 2)))


def _region(
    shape: tuple[int, int],
    camera_matrix: CameraMatrix,
    points_cam: Points,
    size: int,
    margin: float,
) -> tuple[Rows, Int[np.ndarray, "c"], Float[np.ndarray, "3 3"]]:
    """Rows and columns around projected points, at most `size` each, and their camera.

    `margin` (px) is added on each side. Sampling takes the nearest pixel and never enlarges:
    interpolation would invent depth at edges.
    """
    height, width = shape
    points = points_cam[points_cam[:, 2] > NEAR]
    camera = np.array(camera_matrix, dtype=np.float64)
    nothing = np.zeros(0, dtype=int)
    if len(points) == 0:
        return nothing, nothing, camera
    pixels = project(points, camera)
    border = margin + 1.0
    left, top = np.floor(np.maximum(pixels.min(axis=0) - border, 0.0))
    right, bottom = np.ceil(np.minimum(pixels.max(axis=0) + border, [width - 1.0, height - 1.0]))
    if left > right or top > bottom:
        return nothing, nothing, camera
    step = max(max(right - left + 1.0, bottom - top + 1.0) / size, 1.0)
    columns = left + (np.arange(int((right - left + 1.0) / step)) + 0.5) * step - 0.5
    rows = top + (np.arange(int((bottom - top + 1.0) / step)) + 0.5) * step - 0.5
    camera[:2] /= step
    camera[:2, 2] = (np.asarray(camera_matrix)[:2, 2] - [left, top] + 0.5) / step - 0.5
    return np.rint(rows).astype(int), np.rint(columns).astype(int), camera
