"""Compiled part of the verification: draw the mesh in many poses, count what is seen of each."""

import numpy as np
from jaxtyping import Float, Float32, Int, UInt8
from numba import njit

from hlp.refinement.cost_kernel import project_vertices
from hlp.rendering.rasterizer import fill_triangles

FLOOR = 4.0
"""Added to every colour channel: the hue of what is nearly black means nothing."""
SUMS = 11


@njit(nogil=True, cache=True)
def sum_evidence(
    poses: Float[np.ndarray, "n 3 4"],
    vertices: Float[np.ndarray, "3 v"],
    faces: Int[np.ndarray, "f 3"],
    closed: bool,
    chromaticity: Float[np.ndarray, "f 3"],
    camera: Float[np.ndarray, "3 3"],
    size: int,
    depth: Float32[np.ndarray, "h w"],
    rgb: UInt8[np.ndarray, "h w 3"],
    edge_distance: Float32[np.ndarray, "h w"],
    tau_depth: float,
    tau_edge: float,
    tau_color: float,
    step: float,
    sums: Float[np.ndarray, "n 11"],
) -> None:
    """Fill the sums behind `Evidence` of each pose; lengths in m, `edge_distance` in pixels.

    Every n-th pixel of the image is looked at, n the least for which the object's box has at most
    `size` of them; never averages: depth must not be mixed over edges.
    """
    corners = np.empty((3, vertices.shape[1]))
    placed = np.empty((vertices.shape[1], 3))
    for n in range(len(poses)):
        sums[n] = 0.0
        project_vertices(poses[n], vertices, camera, corners)
        middle = np.median(corners[2])
        left, columns, top, rows, pace = _grid(corners, depth.shape, size)
        if middle <= 0.0 or columns <= 0 or rows <= 0:
            continue
        placed[:, 0] = (corners[0] - left) / pace
        placed[:, 1] = (corners[1] - top) / pace
        placed[:, 2] = corners[2]
        inverse = np.zeros((rows, columns))
        seen = np.zeros((rows, columns), dtype=np.int32)
        fill_triangles(placed, faces, closed, inverse, seen)
        _sum_pixels(
            inverse,
            seen,
            chromaticity,
            depth[top::pace, left::pace],
            rgb[top::pace, left::pace],
            edge_distance[top::pace, left::pace],
            tau_depth,
            tau_edge * camera[0, 0] * middle,
            tau_color,
            step,
            sums[n],
        )
        sums[n, 10] = pace * pace


@njit(nogil=True, cache=True)
def _sum_pixels(
    inverse: Float[np.ndarray, "r c"],
    seen: Int[np.ndarray, "r c"],
    chromaticity: Float[np.ndarray, "f 3"],
    depth: Float32[np.ndarray, "r c"],
    rgb: UInt8[np.ndarray, "r c 3"],
    edge_distance: Float32[np.ndarray, "r c"],
    tau_depth: float,
    tau_pixels: float,
    tau_color: float,
    step: float,
    sums: Float[np.ndarray, "11"],
) -> None:
    """Add up the rendered pixels, in the order in which `Evidence` is made of the sums."""
    rows, columns = inverse.shape
    for j in range(rows):
        for i in range(columns):
            if inverse[j, i] <= 0.0:
                continue
            sums[0] += 1.0
            observed = depth[j, i]
            present = observed > 0.0 and np.isfinite(observed)
            apart = observed - 1.0 / inverse[j, i]
            hidden = present and apart < -tau_depth
            if not present:
                sums[5] += 1.0
            elif hidden:
                sums[4] += 1.0
            elif apart > tau_depth:
                sums[3] += 1.0
            else:
                sums[1] += abs(apart) / tau_depth
                sums[2] += 1.0
                face = seen[j, i]
                total = rgb[j, i, 0] + rgb[j, i, 1] + rgb[j, i, 2] + 3.0 * FLOOR
                turned = 0.0
                for c in range(3):
                    turned += abs((rgb[j, i, c] + FLOOR) / total - chromaticity[face, c])
                sums[6] += min(turned / tau_color, 1.0)
            if _is_edge(inverse, j, i, step):
                sums[9] += 1.0
                if hidden:
                    sums[8] += 1.0
                else:
                    sums[7] += min(edge_distance[j, i] / tau_pixels, 1.0)


@njit(nogil=True, cache=True, inline="always")
def _is_edge(inverse: Float[np.ndarray, "r c"], j: int, i: int, step: float) -> bool:
    """Whether a 4-neighbour lies farther by more than `step` (m) or is empty."""
    rows, columns = inverse.shape
    reach = 1.0 / inverse[j, i] + step
    edge = j > 0 and inverse[j - 1, i] * reach < 1.0
    edge |= j < rows - 1 and inverse[j + 1, i] * reach < 1.0
    edge |= i > 0 and inverse[j, i - 1] * reach < 1.0
    edge |= i < columns - 1 and inverse[j, i + 1] * reach < 1.0
    return bool(edge)


@njit(nogil=True, cache=True)
def _grid(
    corners: Float[np.ndarray, "3 v"], shape: tuple[int, int], size: int
) -> tuple[int, int, int, int, int]:
    """First column and number of columns, the same of rows, and the pixels from one to the next.

    One more on each side of the object's box, so that the silhouette has a neighbour.
    """
    left, right, top, bottom = np.inf, -np.inf, np.inf, -np.inf
    for v in range(corners.shape[1]):
        if corners[2, v] > 0.0:
            left, right = min(left, corners[0, v]), max(right, corners[0, v])
            top, bottom = min(top, corners[1, v]), max(bottom, corners[1, v])
    height, width = shape
    if right < 0.0 or bottom < 0.0 or left > width - 1.0 or top > height - 1.0:
        return 0, 0, 0, 0, 1
    pace = max(1, int(np.ceil(max(right - left, bottom - top) / size)))
    first = int(max(np.floor(left) - pace, 0.0))
    last = int(min(np.ceil(right) + pace, width - 1.0))
    above = int(max(np.floor(top) - pace, 0.0))
    below = int(min(np.ceil(bottom) + pace, height - 1.0))
    return first, (last - first) // pace + 1, above, (below - above) // pace + 1, pace
