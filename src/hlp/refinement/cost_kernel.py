"""Compiled part of the cost: draw the mesh in many poses, compare each with the observed depth.

Poses are computed in double precision, pixels in single precision (see `zbuffer`). Only the rows
that a pose covers are cleared and read. The loops are written so that the compiler can turn them
into vector instructions.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Float32

from hlp.arrays import CameraMatrix, Image, Mask, Pose, Poses, Values
from hlp.kernels import compiled, compiled_ahead
from hlp.rendering.zbuffer import (
    VECTOR_WIDTH,
    KernelMesh,
    draw_triangles,
    edge_direction,
    framed_buffer,
    project_vertices,
)

WORST = 1.0
"""Cost of a pose outside the image or without any observed depth where it is rendered."""
_ONE, _ZERO, _INFINITE = np.float32(1.0), np.float32(0.0), np.float32(np.inf)
_Framed = Float32[np.ndarray, "h+2 w+9"]


class RegionImages(NamedTuple):
    """What poses are compared with, in the frame of `zbuffer.framed_buffer`.

    `edge_costs` is one image, or one for each of the verification's directions of an edge.
    """

    observed: _Framed
    edge_costs: Float32[np.ndarray, "d h+2 w+9"]
    reference: _Framed


class Limits(NamedTuple):
    """τ_d and the step of depth at an edge (m), and what pixels without or behind depth cost."""

    tau: np.float32
    step: np.float32
    missing_cost: np.float32
    occluder_cost: np.float32


@compiled_ahead()
def depth_edges(depth: Image, step: float) -> Mask:
    """Edgelets: pixels with a 4-neighbour that is farther by more than `step` (m) or has no depth.

    Only the near side of a discontinuity is marked, because it belongs to the object. The border of
    the image is no discontinuity.
    """
    height, width = depth.shape
    edges = np.zeros((height, width), dtype=np.bool_)
    for y in range(height):
        for x in range(width):
            limit = depth[y, x] + step
            edges[y, x] = depth[y, x] > 0.0 and (
                (y > 0 and _beyond(depth[y - 1, x], limit))
                or (y < height - 1 and _beyond(depth[y + 1, x], limit))
                or (x > 0 and _beyond(depth[y, x - 1], limit))
                or (x < width - 1 and _beyond(depth[y, x + 1], limit))
            )
    return edges


@compiled_ahead()
def draw_mesh(
    pose: Pose, mesh: KernelMesh, camera: CameraMatrix, height: int, width: int
) -> Float32[np.ndarray, "h w"]:
    """Depth (m) of the mesh in a pose, 0 where there is nothing."""
    inverse, depth = framed_buffer(height, width), np.zeros((height, width), dtype=np.float32)
    corners = np.empty(mesh.vertices.shape, dtype=np.float32)
    project_vertices(pose, mesh.vertices, camera, corners)
    draw_triangles(corners, mesh, inverse, None)
    for y in range(height):
        for x in range(width):
            if inverse[y + 1, x + 1] > _ZERO:
                depth[y, x] = _ONE / inverse[y + 1, x + 1]
    return depth


@compiled(inline="always")
def _beyond(depth: float, limit: float) -> bool:
    return not 0.0 < depth <= limit  # true for NaN, too


@compiled_ahead()
def weigh(
    sums: Float[np.ndarray, "n 6"],
    agreed: float,
    weight_depth: float,
    weight_edge: float,
    uncovered_cost: float,
) -> Values:
    """Cost of each pose (paper, Eq. 2; see DepthCost) from its terms (see DepthCost.terms).

    `agreed` is the number of pixels where the coarse pose agreed with the observed depth.
    """
    costs = np.empty(len(sums))
    for n in range(len(sums)):
        depth_sum, pixels, seen, edge_sum, edges, covered = sums[n]
        uncovered = agreed - covered
        area = max(pixels + uncovered, 1.0)
        costs[n] = weight_depth * ((depth_sum + uncovered_cost * uncovered) / area)
        costs[n] += weight_edge * edge_sum / max(edges, 1.0)
        if seen == 0.0:
            costs[n] = WORST
    return costs


@compiled_ahead()
def sum_costs(
    poses: Poses, mesh: KernelMesh, camera: CameraMatrix, images: RegionImages, limits: Limits
) -> Float[np.ndarray, "n 6"]:
    """Draw the mesh in each pose and sum its terms (see DepthCost.terms)."""
    observed = images.observed
    edge_costs = images.edge_costs.reshape(len(images.edge_costs), -1)
    height, width = observed.shape[0] - 2, observed.shape[1] - 1 - VECTOR_WIDTH
    inverse = framed_buffer(height, width)
    stride = inverse.shape[1]
    rows = inverse.reshape(-1), observed.reshape(-1), edge_costs[0], images.reference.reshape(-1)
    corners = np.empty(mesh.vertices.shape, dtype=np.float32)
    sums = np.zeros((len(poses), 6))
    for n in range(len(poses)):
        project_vertices(poses[n], mesh.vertices, camera, corners)
        top, bottom = _extent(corners[1], height)
        if top > bottom:
            continue
        for y in range(max(top - 1, 0), min(bottom + 1, height - 1) + 1):
            inverse[y + 1, 1 : width + 1] = _ZERO
        draw_triangles(corners, mesh, inverse, None)
        span = (top + 1) * stride, (bottom + 2) * stride, stride
        _sum_rows(rows, span, limits, sums[n])
        if len(edge_costs) > 1:
            sums[n, 3] = _sum_directed_edges(rows, edge_costs, span, limits)
    return sums


# Allows the compiler to reorder sums; NaN and infinity keep their meaning.
@compiled(error_model="numpy", fastmath={"reassoc", "contract", "nsz"})
def _sum_directed_edges(
    rows: tuple[Float32[np.ndarray, "p"], ...],
    edge_costs: Float32[np.ndarray, "4 p"],
    span: tuple[int, int, int],
    limits: Limits,
) -> np.float32:
    """The edge term of `_sum_rows`, where each edgelet's cost is that of its own direction."""
    start, stop, stride = span
    whole, observed, costs = rows[0], rows[1][start:stop], edge_costs[:, start:stop]
    above, here = whole[start - stride : stop - stride], whole[start:stop]
    below = whole[start + stride : stop + stride]
    first, second, third, fourth = costs[0], costs[1], costs[2], costs[3]
    total = _ZERO
    for k in range(1, observed.shape[0] - 1):  # the first and the last are of the frame
        inverse = here[k]
        rendered = _ONE / inverse
        beside = here[k - 1], here[k + 1], above[k], below[k]
        drawn = (inverse > _ZERO) & (inverse < _INFINITE)
        edge = drawn & _is_edgelet(rendered, beside, limits.step)
        occluded = (observed[k] > _ZERO) & (rendered - observed[k] > limits.tau)
        direction = edge_direction((above, here, below), k - 1)
        diagonal = second[k] if direction == 1 else fourth[k]
        cost = first[k] if direction == 0 else third[k] if direction == 2 else diagonal
        total += (limits.occluder_cost if occluded else cost) if edge else _ZERO
    return total


@compiled(inline="always")
def _is_edgelet(rendered: np.float32, beside: tuple[np.float32, ...], step: np.float32) -> bool:
    """Whether a 4-neighbour, by its inverse depth, is empty or farther by more than the step."""
    farthest: np.float32 = min(min(beside[0], beside[1]), min(beside[2], beside[3]))
    return farthest < _ONE / (rendered + step)  # type: ignore[return-value]


@compiled(fastmath={"nnan", "nsz", "reassoc"})
def _extent(positions: Float32[np.ndarray, "v"], size: int) -> tuple[int, int]:
    """First and last of `size` rows that contain a position; first > last if none does."""
    least, most = positions[0], positions[0]
    for v in range(positions.shape[0]):
        least, most = min(least, positions[v]), max(most, positions[v])
    first = int(np.floor(min(max(least, _ZERO), np.float32(size))))
    last = int(np.ceil(min(max(most, -_ONE), np.float32(size - 1))))
    return first, last


@compiled(error_model="numpy", fastmath={"reassoc", "contract", "nsz"})
def _sum_rows(
    rows: tuple[Float32[np.ndarray, "p"], ...],
    span: tuple[int, int, int],
    limits: Limits,
    sums: Float[np.ndarray, "6"],
) -> None:
    """Add the terms of whole rows of pixels, including their frame.

    `rows` are the flattened inverse depth, observed depth, edge cost and reference; `span` is the
    first of their pixels, the one after the last, and the length of a row.
    """
    start, stop, stride = span
    whole, observed, edge_cost, reference = rows
    observed, edge_cost = observed[start:stop], edge_cost[start:stop]
    reference, inverse = reference[start:stop], whole[start:stop]
    before, after = whole[start - 1 : stop - 1], whole[start + 1 : stop + 1]
    above, below = whole[start - stride : stop - stride], whole[start + stride : stop + stride]
    tau, step, missing_cost, occluder_cost = limits
    depth_sum, edge_sum, pixels, seen, edges, covered = _ZERO, _ZERO, _ZERO, _ZERO, _ZERO, _ZERO
    per_tau = _ONE / tau
    for x in range(observed.shape[0]):
        here = inverse[x]
        drawn, has_depth = (here > _ZERO) & (here < _INFINITE), observed[x] > _ZERO
        rendered = _ONE / here
        behind = rendered - observed[x]
        limit = occluder_cost if behind > _ZERO else _ONE
        cost = min(abs(behind) * per_tau, limit) if has_depth else missing_cost
        depth_sum += cost if drawn else _ZERO
        pixels += _ONE if drawn else _ZERO
        seen += _ONE if drawn & has_depth else _ZERO
        covered += reference[x] if drawn else _ZERO
        edge = drawn & _is_edgelet(rendered, (before[x], after[x], above[x], below[x]), step)
        occluded = has_depth & (behind > tau)
        edges += _ONE if edge else _ZERO
        edge_sum += (occluder_cost if occluded else edge_cost[x]) if edge else _ZERO
    for k, amount in enumerate((depth_sum, pixels, seen, edge_sum, edges, covered)):
        sums[k] += amount
