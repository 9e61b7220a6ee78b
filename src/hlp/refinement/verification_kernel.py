"""Compiled part of the verification: draw the mesh in many poses, compare each with the image."""

import numpy as np
from jaxtyping import Float, Float32, Int, Int32, UInt8

from hlp.compiled import compiled
from hlp.rendering.zbuffer import draw_triangles, edge_direction, framed_buffer, project_vertices

COLOR_OFFSET = np.float32(4.0)
"""Added to every colour channel, because the chromaticity of dark pixels is mostly noise."""
SUM_COUNT = 11
_ONE, _ZERO, _INFINITE = np.float32(1.0), np.float32(0.0), np.float32(np.inf)
_OFFSETS = np.float32(3.0) * COLOR_OFFSET


@compiled()
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
    edge_distance: Float32[np.ndarray, "4 h w"],
    tau_depth: float,
    tau_edge: float,
    tau_color: float,
    step: float,
    sums: Float[np.ndarray, "n 11"],
) -> None:
    """Fill the sums of which `Evidence` is made for each pose.

    Lengths are in m, `edge_distance` in pixels, for each of the `DIRECTIONS`. The image is read at
    every k-th pixel, k the smallest number for which the object's bounding box has at most `size`
    of them on a side. Pixels are never averaged, which would invent depth at edges.
    """
    corners = np.empty((3, vertices.shape[1]))
    sampled = np.empty((3, vertices.shape[1]), dtype=np.float32)
    for n in range(len(poses)):
        sums[n] = 0.0
        project_vertices(poses[n], vertices, camera, corners)
        left, columns, top, rows, stride = _sampling_grid(corners, depth.shape, size)
        if columns <= 0 or rows <= 0:
            continue
        sampled[0] = (corners[0] - left) / stride
        sampled[1] = (corners[1] - top) / stride
        sampled[2] = corners[2]
        inverse = framed_buffer(rows, columns)
        seen = np.empty(inverse.shape, dtype=np.int32)
        draw_triangles(sampled, faces, closed, inverse, seen)
        tau_pixels = tau_edge * camera[0, 0] * corners[2].mean()
        for j in range(rows):
            y = top + j * stride
            _sum_row(
                inverse[j + 1],
                inverse[j],
                inverse[j + 2],
                seen[j + 1],
                chromaticity,
                depth[y, left::stride],
                rgb[y, left::stride],
                edge_distance[:, y, left::stride],
                np.float32(tau_depth),
                np.float32(tau_pixels),
                np.float32(tau_color),
                np.float32(step),
                columns,
                sums[n],
            )
        sums[n, 10] = stride * stride


@compiled(error_model="numpy")
def _sum_row(
    inverse: Float32[np.ndarray, "c+5"],
    above: Float32[np.ndarray, "c+5"],
    below: Float32[np.ndarray, "c+5"],
    seen: Int32[np.ndarray, "c+5"],
    chromaticity: Float32[np.ndarray, "f 3"],
    depth: Float32[np.ndarray, "c"],
    rgb: UInt8[np.ndarray, "c 3"],
    edge_distance: Float32[np.ndarray, "4 c"],
    tau_depth: np.float32,
    tau_pixels: np.float32,
    tau_color: np.float32,
    step: np.float32,
    columns: int,
    sums: Float[np.ndarray, "11"],
) -> None:
    """Add the pixels of one row; `verification` states the order of the sums."""
    pixels, missing, occluded, behind, agreeing, edges, occluded_edges = 0, 0, 0, 0, 0, 0, 0
    residual, color, edge_sum = _ZERO, _ZERO, _ZERO
    for i in range(columns):
        here = inverse[i + 1]
        if here <= _ZERO:
            continue
        pixels += 1
        rendered = _ONE / here
        difference = depth[i] - rendered
        present = (depth[i] > _ZERO) & (depth[i] < _INFINITE)
        is_occluded = present & (difference < -tau_depth)
        is_behind = present & (difference > tau_depth)
        missing += not present
        occluded += is_occluded
        behind += is_behind
        if present & (abs(difference) <= tau_depth):
            agreeing += 1
            residual += abs(difference) / tau_depth
            color += min(
                _chromaticity_difference(rgb[i], chromaticity[seen[i + 1]]) / tau_color, _ONE
            )
        # An edgelet: a 4-neighbour is empty or farther by more than the step.
        farthest = min(min(inverse[i], inverse[i + 2]), min(above[i + 1], below[i + 1]))
        if farthest * (rendered + step) < _ONE:
            edges += 1
            occluded_edges += is_occluded
            if not is_occluded:
                direction = edge_direction(above[i : i + 3], inverse[i : i + 3], below[i : i + 3])
                edge_sum += min(edge_distance[direction, i] / tau_pixels, _ONE)
    for k, found in enumerate((pixels, agreeing, behind, occluded, missing, edges, occluded_edges)):
        sums[k] += found
    for k, amount in enumerate((residual, color, edge_sum)):
        sums[7 + k] += amount


@compiled(inline="always")
def _chromaticity_difference(
    rgb: UInt8[np.ndarray, "3"], chromaticity: Float32[np.ndarray, "3"]
) -> np.float32:
    """Sum of |Δr|, |Δg|, |Δb| of a colour's chromaticity."""
    red, green, blue = np.float32(rgb[0]), np.float32(rgb[1]), np.float32(rgb[2])
    share = _ONE / (red + green + blue + _OFFSETS)
    difference = abs((red + COLOR_OFFSET) * share - chromaticity[0])
    difference += abs((green + COLOR_OFFSET) * share - chromaticity[1])
    difference += abs((blue + COLOR_OFFSET) * share - chromaticity[2])
    return np.float32(difference)


@compiled()
def _sampling_grid(
    corners: Float[np.ndarray, "3 v"], shape: tuple[int, int], size: int
) -> tuple[int, int, int, int, int]:
    """First column, number of columns, first row, number of rows, and the stride between them (px).

    It has one more pixel than the object's bounding box on each side, as neighbours of the
    silhouette.
    """
    left, right, top, bottom = np.inf, -np.inf, np.inf, -np.inf
    for v in range(corners.shape[1]):
        if corners[2, v] > 0.0:
            left, right = min(left, corners[0, v]), max(right, corners[0, v])
            top, bottom = min(top, corners[1, v]), max(bottom, corners[1, v])
    height, width = shape
    if right < 0.0 or bottom < 0.0 or left > width - 1.0 or top > height - 1.0:
        return 0, 0, 0, 0, 1
    stride = max(1, int(np.ceil(max(right - left, bottom - top) / size)))
    first = int(max(np.floor(left) - stride, 0.0))
    last = int(min(np.ceil(right) + stride, width - 1.0))
    above = int(max(np.floor(top) - stride, 0.0))
    below = int(min(np.ceil(bottom) + stride, height - 1.0))
    return first, (last - first) // stride + 1, above, (below - above) // stride + 1, stride
