"""Compiled part of the verification: draw the mesh in many poses, count what is seen of each."""

import numpy as np
from jaxtyping import Float, Float32, Int, Int32, UInt8
from numba import njit

from hlp.rendering.zbuffer import draw_triangles, framed, project_vertices

FLOOR = np.float32(4.0)
"""Added to every colour channel: the hue of what is nearly black means nothing."""
SUMS = 11
_ONE, _ZERO, _FAR = np.float32(1.0), np.float32(0.0), np.float32(np.inf)
_FLOORS = np.float32(3.0) * FLOOR


@njit(nogil=True, cache=True)
def sum_evidence(
    poses: Float[np.ndarray, "n 4 4"],
    vertices: Float[np.ndarray, "3 v"],
    faces: Int[np.ndarray, "f 3"],
    closed: bool,
    chromaticity: Float32[np.ndarray, "f 3"],
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
    placed = np.empty((3, vertices.shape[1]), dtype=np.float32)
    for n in range(len(poses)):
        sums[n] = 0.0
        project_vertices(poses[n], vertices, camera, corners)
        left, columns, top, rows, pace = _grid(corners, depth.shape, size)
        if columns <= 0 or rows <= 0:
            continue
        placed[0] = (corners[0] - left) / pace
        placed[1] = (corners[1] - top) / pace
        placed[2] = corners[2]
        inverse = framed(rows, columns)
        seen = np.empty(inverse.shape, dtype=np.int32)
        draw_triangles(placed, faces, closed, inverse, seen)
        reach = tau_edge * camera[0, 0] * corners[2].mean()
        for j in range(rows):
            y = top + j * pace
            _sum_row(
                inverse[j + 1],
                inverse[j],
                inverse[j + 2],
                seen[j + 1],
                chromaticity,
                depth[y, left::pace],
                rgb[y, left::pace],
                edge_distance[y, left::pace],
                np.float32(tau_depth),
                np.float32(reach),
                np.float32(tau_color),
                np.float32(step),
                columns,
                sums[n],
            )
        sums[n, 10] = pace * pace


@njit(nogil=True, cache=True, error_model="numpy")
def _sum_row(
    inverse: Float32[np.ndarray, "c+5"],
    above: Float32[np.ndarray, "c+5"],
    below: Float32[np.ndarray, "c+5"],
    seen: Int32[np.ndarray, "c+5"],
    chromaticity: Float32[np.ndarray, "f 3"],
    depth: Float32[np.ndarray, "c"],
    rgb: UInt8[np.ndarray, "c 3"],
    edge_distance: Float32[np.ndarray, "c"],
    tau_depth: np.float32,
    tau_pixels: np.float32,
    tau_color: np.float32,
    step: np.float32,
    columns: int,
    sums: Float[np.ndarray, "11"],
) -> None:
    """Add one row's pixels, in the order in which `Evidence` is made of the sums."""
    pixels, missing, occluded, behind, agreeing, edges, hidden_edges = 0, 0, 0, 0, 0, 0, 0
    residual, color, edge_sum = _ZERO, _ZERO, _ZERO
    for i in range(columns):
        here = inverse[i + 1]
        if here <= _ZERO:
            continue
        pixels += 1
        rendered = _ONE / here
        apart = depth[i] - rendered
        present = (depth[i] > _ZERO) & (depth[i] < _FAR)
        covered = present & (apart < -tau_depth)
        beyond = present & (apart > tau_depth)
        missing += not present
        occluded += covered
        behind += beyond
        if present & (abs(apart) <= tau_depth):
            agreeing += 1
            residual += abs(apart) / tau_depth
            color += min(_turned(rgb[i], chromaticity[seen[i + 1]]) / tau_color, _ONE)
        # An edgelet: a 4-neighbour is empty or farther by more than the step.
        farthest = min(min(inverse[i], inverse[i + 2]), min(above[i + 1], below[i + 1]))
        if farthest * (rendered + step) < _ONE:
            edges += 1
            hidden_edges += covered
            edge_sum += _ZERO if covered else min(edge_distance[i] / tau_pixels, _ONE)
    for k, found in enumerate((pixels, agreeing, behind, occluded, missing, edges, hidden_edges)):
        sums[k] += found
    for k, amount in enumerate((residual, color, edge_sum)):
        sums[7 + k] += amount


@njit(nogil=True, cache=True, inline="always")
def _turned(rgb: UInt8[np.ndarray, "3"], chromaticity: Float32[np.ndarray, "3"]) -> np.float32:
    """Sum of |Δr|, |Δg|, |Δb| of a colour's chromaticity."""
    red, green, blue = np.float32(rgb[0]), np.float32(rgb[1]), np.float32(rgb[2])
    share = _ONE / (red + green + blue + _FLOORS)
    turned = abs((red + FLOOR) * share - chromaticity[0])
    turned += abs((green + FLOOR) * share - chromaticity[1])
    turned += abs((blue + FLOOR) * share - chromaticity[2])
    return np.float32(turned)


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
