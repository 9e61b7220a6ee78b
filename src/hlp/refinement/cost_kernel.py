"""Compiled part of the cost: draw the mesh in many poses, compare each with the observed depth."""

import numpy as np
from jaxtyping import Bool, Float, Int
from numba import njit

from hlp.rendering.rasterizer import NEAR, fill_triangles


@njit(nogil=True, cache=True)
def project_vertices(
    pose: Float[np.ndarray, "3 4"],
    vertices: Float[np.ndarray, "v 3"],
    camera: Float[np.ndarray, "3 3"],
    corners: Float[np.ndarray, "v 3"],
) -> None:
    """(x px, y px, 1/z) of each vertex; 1/z = 0 where it is nearer than NEAR."""
    fx, fy, cx, cy = camera[0, 0], camera[1, 1], camera[0, 2], camera[1, 2]
    for v in range(vertices.shape[0]):
        a, b, c = vertices[v, 0], vertices[v, 1], vertices[v, 2]
        z = pose[2, 0] * a + pose[2, 1] * b + pose[2, 2] * c + pose[2, 3]
        if z < NEAR:
            corners[v, :] = 0.0
            continue
        inverse = 1.0 / z
        x = pose[0, 0] * a + pose[0, 1] * b + pose[0, 2] * c + pose[0, 3]
        y = pose[1, 0] * a + pose[1, 1] * b + pose[1, 2] * c + pose[1, 3]
        corners[v, 0] = x * inverse * fx + cx
        corners[v, 1] = y * inverse * fy + cy
        corners[v, 2] = inverse


@njit(nogil=True, cache=True)
def sum_costs(
    poses: Float[np.ndarray, "n 3 4"],
    vertices: Float[np.ndarray, "v 3"],
    faces: Int[np.ndarray, "f 3"],
    closed: bool,
    camera: Float[np.ndarray, "3 3"],
    observed: Float[np.ndarray, "h w"],
    edge_cost: Float[np.ndarray, "h w"],
    reference: Bool[np.ndarray, "h w"],
    tau: float,
    step: float,
    missing_cost: float,
    occluder_cost: float,
    sums: Float[np.ndarray, "n 6"],
) -> None:
    """Draw the mesh in each pose and fill `sums` with its terms (see DepthCost.terms)."""
    height, width = observed.shape
    inverse = np.empty(observed.shape)
    depth = np.empty(observed.shape)
    corners = np.empty((vertices.shape[0], 3))
    for n in range(poses.shape[0]):
        project_vertices(poses[n], vertices, camera, corners)
        inverse[:] = 0.0
        fill_triangles(corners, faces, closed, inverse, None)
        for y in range(height):
            for x in range(width):
                depth[y, x] = 1.0 / inverse[y, x] if inverse[y, x] > 0.0 else np.inf
        _sum_pixels(
            depth, observed, edge_cost, reference, tau, step, missing_cost, occluder_cost, sums[n]
        )


@njit(nogil=True, cache=True)
def _sum_pixels(
    depth: Float[np.ndarray, "h w"],
    observed: Float[np.ndarray, "h w"],
    edge_cost: Float[np.ndarray, "h w"],
    reference: Bool[np.ndarray, "h w"],
    tau: float,
    step: float,
    missing_cost: float,
    occluder_cost: float,
    sums: Float[np.ndarray, "6"],
) -> None:
    """Terms of one rendered depth (infinite where nothing is)."""
    depth_sum, edge_sum = 0.0, 0.0
    pixels, observations, edges, covered = 0, 0, 0, 0
    height, width = observed.shape
    for y in range(height):
        for x in range(width):
            rendered, seen = depth[y, x], observed[y, x]
            if rendered == np.inf:
                continue
            pixels += 1
            covered += reference[y, x]
            occluded = False
            if seen <= 0.0:
                depth_sum += missing_cost
            else:
                observations += 1
                occluded = rendered - seen > tau
                limit = occluder_cost if seen < rendered else 1.0
                depth_sum += min(abs(seen - rendered) / tau, limit)
            if _is_edge(depth, y, x, rendered + step):
                edges += 1
                edge_sum += occluder_cost if occluded else edge_cost[y, x]
    sums[0], sums[1], sums[2] = depth_sum, pixels, observations
    sums[3], sums[4], sums[5] = edge_sum, edges, covered


@njit(nogil=True, cache=True, inline="always")
def _is_edge(depth: Float[np.ndarray, "h w"], y: int, x: int, far: float) -> bool:
    """Whether a 4-neighbour within the region lies beyond `far`."""
    return bool(
        (x > 0 and depth[y, x - 1] > far)
        or (x + 1 < depth.shape[1] and depth[y, x + 1] > far)
        or (y > 0 and depth[y - 1, x] > far)
        or (y + 1 < depth.shape[0] and depth[y + 1, x] > far)
    )
