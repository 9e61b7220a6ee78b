"""Cost of a pose on its own: which of several hypotheses is right, and how sure is it.

The search's cost (Eq. 2) is relative to a coarse pose and shaped to pull. This one compares poses
that come from anywhere. Beside depth and edgelets it looks at colour: where an object's surface is
seen it has the model's colours, of which only the chromaticity is compared, since brightness is
the light's.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int, UInt8
from numba import njit

from hlp.geometry import project, transform
from hlp.records import ObjectModel
from hlp.refinement.cost import WORST, depth_edges, edge_distances
from hlp.rendering.rasterizer import NEAR, fill_triangles, is_closed

_LEAST_SUPPORT, _LEAST_SHARE = 1e-12, 0.01
_FLOOR = 4.0  # added to every channel: the hue of what is nearly black means nothing


@dataclass(frozen=True)
class VerificationSettings:
    """Settings; see conf/refinement/verification/hlp.yaml for what each means."""

    candidates: int
    weight_depth: float
    weight_edge: float
    weight_color: float
    tau_depth_mm: float
    tau_edge_mm: float
    tau_color: float
    edge_step_mm: float
    missing_cost: float
    hidden_cost: float
    hidden_share_cost: float
    hidden_edge_cost: float
    unexplained_cost: float
    backing_cost: float
    roi_size: int


@dataclass(frozen=True)
class Evidence:
    """What an image says about one pose, in shares of the rendered pixels (edges: edgelets).

    `residual` is the mean of |S − O| / τ_d where it is below 1, counted over all pixels; `behind`
    shows a surface beyond the object, `hidden` one before it, `missing` no depth. `color` is the
    mean of min(|Δ chromaticity|₁, τ_c) / τ_c where depth agrees. `edge` is the mean distance to
    O's closest edgelet over τ_e where the edgelet is not hidden, `edge_hidden` the hidden share.
    `area` is what agrees, in the image's pixels.
    """

    pixels: int
    area: float
    residual: float
    behind: float
    hidden: float
    missing: float
    color: float
    edge: float
    edge_hidden: float


class Verifier:
    """Verification cost of poses of one object."""

    def __init__(self, model: ObjectModel, settings: VerificationSettings) -> None:
        mesh = model.proxy
        self._settings = settings
        self._centroid, self._radius = model.centroid, model.diameter / 2.0
        self._vertices = np.ascontiguousarray(mesh.vertices, dtype=np.float64)
        self._faces = np.ascontiguousarray(mesh.faces, dtype=np.int32)
        self._closed = is_closed(self._faces, self._vertices)
        raised = mesh.colors[mesh.faces].mean(axis=1) + _FLOOR
        self._chromaticity = raised / raised.sum(axis=1, keepdims=True)

    def costs(
        self,
        rgb: UInt8[np.ndarray, "h w 3"],
        depth: Float[np.ndarray, "h w"],
        camera_matrix: Float[np.ndarray, "3 3"],
        poses_cam_obj: Float[np.ndarray, "n 4 4"],
    ) -> Float[np.ndarray, "n"]:
        """Cost in [0, 1] of each pose, lower is better; comparable between poses of one object."""
        evidence = (self.evidence(rgb, depth, camera_matrix, pose) for pose in poses_cam_obj)
        return np.array([WORST if each is None else self.weigh(each) for each in evidence])

    def rival_costs(
        self,
        rgb: UInt8[np.ndarray, "h w 3"],
        depth: Float[np.ndarray, "h w"],
        camera_matrix: Float[np.ndarray, "3 3"],
        poses_cam_obj: Float[np.ndarray, "n 4 4"],
        support: Float[np.ndarray, "n"],
    ) -> Float[np.ndarray, "n"]:
        """Cost in [0, 1] of each pose beside the others.

        A mean over what a pose shows favours poses that show little. So a pose pays for what it
        leaves unexplained: the share by which its agreeing area falls short of the largest among
        the poses at its place, whose centroids are within half a diameter. It pays as well for few
        votes, by the logarithm of the largest `support` over its own, as votes are evidence too.
        """
        found = [self.evidence(rgb, depth, camera_matrix, pose) for pose in poses_cam_obj]
        alone = np.array([WORST if each is None else self.weigh(each) for each in found])
        area = np.array([0.0 if each is None else each.area for each in found])
        centers = transform(poses_cam_obj, self._centroid[None])[:, 0]
        apart = np.linalg.norm(centers[:, None] - centers, axis=-1)
        largest = np.where(apart < self._radius, area, 0.0).max(axis=1, initial=1.0)
        costs = alone + self._settings.unexplained_cost * (1.0 - area / largest)
        share = support / max(float(support.max(initial=0.0)), _LEAST_SUPPORT)
        costs -= self._settings.backing_cost * np.log(np.maximum(share, _LEAST_SHARE))
        return np.asarray(np.minimum(costs, WORST))

    def weigh(self, evidence: Evidence) -> float:
        """Cost of what was seen.

        A hidden pixel costs more, the more of the object is hidden: right poses may be half
        hidden, but one that hides almost wholly is hardly believed.
        """
        settings = self._settings
        price = settings.hidden_cost + settings.hidden_share_cost * evidence.hidden
        depth = evidence.residual + evidence.behind
        depth += price * evidence.hidden + settings.missing_cost * evidence.missing
        edge = (1.0 - evidence.edge_hidden) * evidence.edge
        edge += settings.hidden_edge_cost * evidence.edge_hidden
        parts = settings.weight_depth * depth + settings.weight_edge * edge
        parts += settings.weight_color * evidence.color
        whole = settings.weight_depth + settings.weight_edge + settings.weight_color
        return float(np.clip(parts / whole, 0.0, 1.0))

    def evidence(
        self,
        rgb: UInt8[np.ndarray, "h w 3"],
        depth: Float[np.ndarray, "h w"],
        camera_matrix: Float[np.ndarray, "3 3"],
        pose_cam_obj: Float[np.ndarray, "4 4"],
    ) -> Evidence | None:
        """What the image says about a pose; None where it shows no depth at all there."""
        settings = self._settings
        points = transform(pose_cam_obj, self._vertices)
        columns, rows, camera = _grid(points, depth.shape, camera_matrix, settings.roi_size)
        if len(columns) == 0 or len(rows) == 0:
            return None
        observed = depth[rows[:, None], columns].astype(np.float64)
        observed[~np.isfinite(observed)] = 0.0
        inverse = np.zeros(observed.shape)
        faces = np.zeros(observed.shape, dtype=np.int32)
        fill_triangles(_corners(points, camera), self._faces, self._closed, inverse, faces)
        step = settings.edge_step_mm / 1000.0
        rendered = np.where(inverse > 0.0, 1.0 / np.where(inverse > 0.0, inverse, 1.0), 0.0)
        tau_pixels = settings.tau_edge_mm / 1000.0 * camera[0, 0] / float(np.median(points[:, 2]))
        sums = _sum_evidence(
            rendered,
            observed,
            depth_edges(rendered, step),
            edge_distances(observed, step) / tau_pixels,
            faces,
            self._chromaticity,
            rgb[rows[:, None], columns],
            settings.tau_depth_mm / 1000.0,
            settings.tau_color,
        )
        scale = camera_matrix[0, 0] / camera[0, 0]
        return _in_shares(sums, scale * scale)


def least(costs: Float[np.ndarray, "n"], count: int) -> Int[np.ndarray, "c"]:
    """Indices of the `count` least costs, ascending; the earlier where costs are equal."""
    return np.sort(np.argsort(costs, kind="stable")[:count])


def _in_shares(sums: Float[np.ndarray, "10"], pixel_area: float) -> Evidence | None:
    pixels, residual, agreeing, behind, hidden, missing, color, edge, edge_hidden, edges = sums
    if pixels == missing:  # nothing drawn, or nothing observed under it
        return None
    return Evidence(
        int(pixels),
        agreeing * pixel_area,
        residual / pixels,
        behind / pixels,
        hidden / pixels,
        missing / pixels,
        color / agreeing if agreeing else 1.0,
        edge / (edges - edge_hidden) if edges > edge_hidden else 1.0,
        edge_hidden / edges if edges else 0.0,
    )


@njit(nogil=True, cache=True)
def _sum_evidence(
    rendered: Float[np.ndarray, "h w"],
    observed: Float[np.ndarray, "h w"],
    edges: np.ndarray,
    edge_distance: Float[np.ndarray, "h w"],
    faces: Int[np.ndarray, "h w"],
    chromaticity: Float[np.ndarray, "f 3"],
    rgb: UInt8[np.ndarray, "h w 3"],
    tau_depth: float,
    tau_color: float,
) -> Float[np.ndarray, "10"]:
    """Sums behind `Evidence`, in the order that `_in_shares` reads them."""
    sums = np.zeros(10)
    height, width = rendered.shape
    for y in range(height):
        for x in range(width):
            if rendered[y, x] <= 0.0:
                continue
            sums[0] += 1.0
            apart = observed[y, x] - rendered[y, x]
            hidden = observed[y, x] > 0.0 and apart < -tau_depth
            if observed[y, x] <= 0.0:
                sums[5] += 1.0
            elif hidden:
                sums[4] += 1.0
            elif apart > tau_depth:
                sums[3] += 1.0
            else:
                sums[1] += abs(apart) / tau_depth
                sums[2] += 1.0
                total = rgb[y, x, 0] + rgb[y, x, 1] + rgb[y, x, 2] + 3.0 * _FLOOR
                turned = 0.0
                for c in range(3):
                    share = (rgb[y, x, c] + _FLOOR) / total
                    turned += abs(share - chromaticity[faces[y, x], c])
                sums[6] += min(turned / tau_color, 1.0)
            if edges[y, x]:
                sums[9] += 1.0
                if hidden:
                    sums[8] += 1.0
                else:
                    sums[7] += min(edge_distance[y, x], 1.0)
    return sums


def _corners(
    points_cam: Float[np.ndarray, "v 3"], camera: Float[np.ndarray, "3 3"]
) -> Float[np.ndarray, "v 3"]:
    """(x px, y px, 1/z) of each vertex; 1/z = 0 where it is nearer than NEAR."""
    drawn = points_cam[:, 2] > NEAR
    safe = np.where(drawn[:, None], points_cam, [0.0, 0.0, 1.0])
    return np.column_stack([project(safe, camera), np.where(drawn, 1.0 / safe[:, 2], 0.0)])


def _grid(
    points_cam: Float[np.ndarray, "v 3"],
    shape: tuple[int, ...],
    camera_matrix: Float[np.ndarray, "3 3"],
    size: int,
) -> tuple[Int[np.ndarray, "c"], Int[np.ndarray, "r"], Float[np.ndarray, "3 3"]]:
    """Columns and rows of the image that sample the object's box, and the camera of that grid.

    One more on each side, so that the silhouette has a neighbour; every n-th pixel, never
    averages: depth must not be mixed over edges.
    """
    empty = np.zeros(0, dtype=np.int64)
    camera = np.array(camera_matrix, dtype=np.float64)
    points = points_cam[points_cam[:, 2] > NEAR]
    if len(points) == 0:
        return empty, empty, camera
    pixels = project(points, camera)
    low, high = pixels.min(axis=0), pixels.max(axis=0)
    step = max(1, int(np.ceil((high - low).max() / size)))
    low = np.maximum(np.floor(low) - step, 0.0)
    high = np.minimum(np.ceil(high) + step, [shape[1] - 1.0, shape[0] - 1.0])
    columns = np.arange(low[0], high[0] + 1, step).astype(np.int64)
    rows = np.arange(low[1], high[1] + 1, step).astype(np.int64)
    camera[:2, 2] -= low
    camera[:2] /= step
    return columns, rows, camera
