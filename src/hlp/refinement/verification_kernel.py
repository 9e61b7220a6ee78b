"""Compiled part of the verification: draw the mesh in many poses, compare each with the image."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Float32, Int32, UInt8

from hlp.arrays import CameraMatrix, Poses, Rgb
from hlp.kernels import compiled, compiled_ahead
from hlp.rendering.zbuffer import (
    KernelMesh,
    ThreeRows,
    draw_triangles,
    edge_direction,
    framed_buffer,
    project_vertices,
)

COLOR_OFFSET = np.float32(4.0)
"""Added to every colour channel, because the chromaticity of dark pixels is mostly noise."""
_ONE, _ZERO, _INFINITE = np.float32(1.0), np.float32(0.0), np.float32(np.inf)
_OFFSETS = np.float32(3.0) * COLOR_OFFSET


class SeenImages(NamedTuple):
    """What poses are compared with; `edge_distance` (px) is that of each of the `DIRECTIONS`."""

    depth: Float32[np.ndarray, "h w"]
    rgb: Rgb
    edge_distance: Float32[np.ndarray, "4 h w"]


class Tolerances(NamedTuple):
    """Limits of differences in depth (m), of edges (m) and in colour; the step at an edge (m)."""

    depth: float
    edge: float
    color: float
    step: float


@compiled_ahead()
def sum_evidence(
    poses: Poses,
    mesh: KernelMesh,
    chromaticity: Float32[np.ndarray, "f 3"],
    camera: CameraMatrix,
    images: SeenImages,
    limits: Tolerances,
    size: int,
) -> Float[np.ndarray, "n 11"]:
    """The sums of which `Evidence` is made for each pose.

    The image is read at every k-th pixel, k the smallest number for which the object's bounding box
    has at most `size` of them on a side. Pixels are never averaged: that invents depths.
    """
    depth, rgb, edge_distance = images
    corners = np.empty(mesh.vertices.shape)
    sampled = np.empty(mesh.vertices.shape, dtype=np.float32)
    sums = np.zeros((len(poses), 11))
    for n in range(len(poses)):
        project_vertices(poses[n], mesh.vertices, camera, corners)
        left, columns, top, rows, stride = _sampling_grid(corners, depth.shape, size)
        if columns <= 0 or rows <= 0:
            continue
        for v in range(len(corners[0])):
            sampled[0, v] = (corners[0, v] - left) / stride
            sampled[1, v] = (corners[1, v] - top) / stride
            sampled[2, v] = corners[2, v]
        inverse = framed_buffer(rows, columns)
        seen = np.empty(inverse.shape, dtype=np.int32)
        draw_triangles(sampled, mesh, inverse, seen)
        tau_pixels = limits.edge * camera[0, 0] * corners[2].mean()
        taus = np.float32(limits.depth), np.float32(tau_pixels), np.float32(limits.color)
        for j in range(rows):
            y = top + j * stride
            row = depth[y, left::stride], rgb[y, left::stride], edge_distance[:, y, left::stride]
            around = inverse[j], inverse[j + 1], inverse[j + 2]
            faces = chromaticity, seen[j + 1]
            _sum_row(around, faces, row, taus, np.float32(limits.step), columns, sums[n])
        sums[n, 10] = stride * stride
    return sums


@compiled(error_model="numpy")
def _sum_row(
    around: ThreeRows,
    faces: tuple[Float32[np.ndarray, "f 3"], Int32[np.ndarray, "c+9"]],
    row: tuple[Float32[np.ndarray, "c"], UInt8[np.ndarray, "c 3"], Float32[np.ndarray, "4 c"]],
    taus: tuple[np.float32, np.float32, np.float32],
    step: np.float32,
    columns: int,
    sums: Float[np.ndarray, "11"],
) -> None:
    """Add the pixels of one row; `verification` states the order of the sums.

    `around` are the inverse depths of the row above, of the row itself and of that below, `faces`
    the chromaticity of all faces and those that the row shows, `row` that of the images.
    """
    inverse, (chromaticity, seen), (depth, rgb, edge_distance) = around[1], faces, row
    tau_depth, tau_pixels, tau_color = taus
    pixels, missing, occluded, behind, agreeing, edges, occluded_edges = 0, 0, 0, 0, 0, 0, 0
    residual, color, edge_sum = _ZERO, _ZERO, _ZERO
    for i in range(columns):
        if inverse[i + 1] <= _ZERO:
            continue
        rendered = _ONE / inverse[i + 1]
        present, is_occluded, is_behind, agrees = _compare(depth[i], rendered, tau_depth)
        pixels += 1
        missing += not present
        occluded += is_occluded
        behind += is_behind
        if agrees:
            agreeing += 1
            residual += abs(depth[i] - rendered) / tau_depth
            color += _color_cost(rgb[i], chromaticity[seen[i + 1]], tau_color)
        if _is_edgelet(around, i, rendered + step):
            edges += 1
            occluded_edges += is_occluded
            if not is_occluded:
                edge_sum += _edge_cost(around, edge_distance, i, tau_pixels)
    for k, found in enumerate((pixels, agreeing, behind, occluded, missing, edges, occluded_edges)):
        sums[k] += found
    for k, amount in enumerate((residual, color, edge_sum)):
        sums[7 + k] += amount


@compiled(inline="always")
def _compare(depth: np.float32, rendered: np.float32, tau: np.float32) -> tuple[bool, ...]:
    """Whether there is a depth; whether it is nearer, farther, or the same within the tolerance."""
    present, difference = (depth > _ZERO) & (depth < _INFINITE), depth - rendered
    nearer, farther = present & (difference < -tau), present & (difference > tau)
    same = present & (abs(difference) <= tau)
    return present, nearer, farther, same  # type: ignore[return-value]


@compiled(inline="always")
def _color_cost(
    rgb: UInt8[np.ndarray, "3"], chromaticity: Float32[np.ndarray, "3"], tau: np.float32
) -> np.float32:
    """Sum of |Δr|, |Δg|, |Δb| of a colour's chromaticity, in units of the tolerance, at most 1."""
    red, green, blue = np.float32(rgb[0]), np.float32(rgb[1]), np.float32(rgb[2])
    share = _ONE / (red + green + blue + _OFFSETS)
    difference = abs((red + COLOR_OFFSET) * share - chromaticity[0])
    difference += abs((green + COLOR_OFFSET) * share - chromaticity[1])
    difference += abs((blue + COLOR_OFFSET) * share - chromaticity[2])
    return np.float32(min(difference / tau, _ONE))


@compiled(inline="always")
def _is_edgelet(around: ThreeRows, i: int, limit: np.float32) -> np.bool_:
    """Whether a 4-neighbour of the row's pixel i is empty, or farther than a limit (m)."""
    above, here, below = around
    farthest: np.float32 = min(min(here[i], here[i + 2]), min(above[i + 1], below[i + 1]))
    return farthest * limit < _ONE


@compiled(inline="always")
def _edge_cost(
    around: ThreeRows, distance: Float32[np.ndarray, "4 c"], i: int, tau: np.float32
) -> np.float32:
    """Distance (in units of the tolerance, at most 1) to an edge of the direction of this one."""
    return min(distance[edge_direction(around, i), i] / tau, _ONE)


@compiled()
def _sampling_grid(
    corners: Float[np.ndarray, "3 v"], shape: tuple[int, int], size: int
) -> tuple[int, int, int, int, int]:
    """First column, number of columns, first row, number of rows, and the stride between them (px).

    It has one more pixel than the object's bounding box on each side, for neighbours.
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
