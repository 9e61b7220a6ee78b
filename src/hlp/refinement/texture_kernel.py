"""Kernels of `texture`: a seen surface, and how an image's colours differ from those on it."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Float32, UInt8

from hlp.arrays import CameraMatrix, Image, Mask, Point, Points, Pose, Poses, Values
from hlp.kernels import compiled


@compiled()
def surface_and_normals(
    depth: Image, used: Mask, count: int, camera: CameraMatrix
) -> tuple[Points, Points]:
    """Points (m, camera coordinates) that the `count` used pixels show, row by row, and normals.

    Normals are of length 1, from the neighbours of each pixel; at the image's border from one
    direction alone, so 0.
    """
    height, width = depth.shape
    points, normals = np.empty((count, 3)), np.empty((count, 3))
    left, right, above, below = np.zeros(3), np.zeros(3), np.zeros(3), np.zeros(3)
    row = 0
    for y in range(height):
        for x in range(width):
            if not used[y, x]:
                continue
            _back_project(x, y, depth, camera, points[row])
            normal = normals[row]
            row += 1
            if not (0 < x < width - 1 and 0 < y < height - 1):
                normal[:] = 0.0
                continue
            _back_project(x - 1, y, depth, camera, left)
            _back_project(x + 1, y, depth, camera, right)
            _back_project(x, y - 1, depth, camera, above)
            _back_project(x, y + 1, depth, camera, below)
            for k in range(3):
                right[k] -= left[k]
                below[k] -= above[k]
            normal[0] = right[1] * below[2] - right[2] * below[1]
            normal[1] = right[2] * below[0] - right[0] * below[2]
            normal[2] = right[0] * below[1] - right[1] * below[0]
            squared = normal[0] * normal[0] + normal[1] * normal[1] + normal[2] * normal[2]
            for k in range(3):
                normal[k] /= max(np.sqrt(squared), 1e-12)
    return points, normals


@compiled(inline="always")
def _back_project(x: int, y: int, depth: Image, camera: CameraMatrix, point: Point) -> None:
    """Fill the point (m) that a pixel shows, as `geometry.back_project` computes it."""
    z = float(depth[y, x])
    point[0] = (x - camera[0, 2]) / camera[0, 0] * z
    point[1] = (y - camera[1, 2]) / camera[1, 1] * z
    point[2] = z


class SeenSurface(NamedTuple):
    """Pixels that show the object: colours' logarithms, points in its coordinates, light basis."""

    colors: Float32[np.ndarray, "p 3"]
    points: Points
    light: Float[np.ndarray, "p 4"]


class LogarithmGrid(NamedTuple):
    """A `ColorGrid`, with the logarithms of its colours' 256 values."""

    colors: UInt8[np.ndarray, "x y z 3"]
    corner: Point
    cell: float
    logarithms: Float32[np.ndarray, "256"]


@compiled()
def sum_color_differences(
    seen: SeenSurface, motions: Poses, grid: LogarithmGrid, limit: float, white_balance: float
) -> Values:
    """The mean squared difference of the colours for each motion; see `texture`.

    The grid is read at the points after each motion. The columns of `light` are orthonormal; what
    of the mean over the channels they explain is light. The rest and each channel's deviation count
    up to `limit`; `white_balance` is the weight of the channels' mean deviations.
    """
    points, light = seen.points, seen.light
    differences = np.empty(len(motions))
    count = len(points)
    difference = np.empty((count, 4))
    shading = np.empty(light.shape[1])
    mean = np.empty(3)
    limit_squared = limit * limit
    for n in range(len(motions)):
        _subtract_colors(seen, motions[n], grid, difference)
        shading[:] = 0.0
        mean[:] = 0.0
        for p in range(count):
            for k in range(light.shape[1]):
                shading[k] += light[p, k] * difference[p, 3]
            for channel in range(3):
                mean[channel] += difference[p, channel] / count
        total = 0.0
        for p in range(count):
            rest = difference[p, 3]
            for k in range(light.shape[1]):
                rest -= light[p, k] * shading[k]
            total += min(rest * rest, limit_squared)
            for channel in range(3):
                deviation = difference[p, channel] - mean[channel]
                total += min(deviation * deviation, limit_squared)
        total /= count
        for channel in range(3):
            total += white_balance * mean[channel] * mean[channel]
        differences[n] = total
    return differences


@compiled(inline="always")
def _subtract_colors(
    seen: SeenSurface, motion: Pose, grid: LogarithmGrid, difference: Float[np.ndarray, "p 4"]
) -> None:
    """Fill the channels' differences from their mean, and the mean itself in the last column."""
    observed, points = seen.colors, seen.points
    colors, corner, cell, logarithms = grid
    index = np.empty(3, dtype=np.int64)
    for p in range(len(points)):
        for axis in range(3):
            value = motion[axis, 3] - corner[axis]
            for k in range(3):
                value += motion[axis, k] * points[p, k]
            index[axis] = min(max(int(np.floor(value / cell)), 0), colors.shape[axis] - 1)
        mean = 0.0
        for channel in range(3):
            stored = logarithms[colors[index[0], index[1], index[2], channel]]
            difference[p, channel] = observed[p, channel] - stored
            mean += difference[p, channel] / 3.0
        for channel in range(3):
            difference[p, channel] -= mean
        difference[p, 3] = mean
