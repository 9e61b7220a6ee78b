"""Kernels of `texture`: a seen surface, and how an image's colours differ from those on it."""

import numpy as np
from jaxtyping import Bool, Float, Float32, UInt8

from hlp.compiled import compiled


@compiled()
def surface_and_normals(
    depth: Float32[np.ndarray, "h w"],
    used: Bool[np.ndarray, "h w"],
    camera: Float[np.ndarray, "3 3"],
    points: Float[np.ndarray, "p 3"],
    normals: Float[np.ndarray, "p 3"],
) -> None:
    """Fill the points (m, camera coordinates) that the used pixels show, row by row, and normals.

    Normals are of length 1, from the neighbours of each pixel; at the image's border from one
    direction alone, so 0.
    """
    height, width = depth.shape
    left, right, above, below = np.zeros(3), np.zeros(3), np.zeros(3), np.zeros(3)
    count = 0
    for y in range(height):
        for x in range(width):
            if not used[y, x]:
                continue
            _back_project(x, y, depth, camera, points[count])
            normal = normals[count]
            count += 1
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


@compiled(inline="always")
def _back_project(
    x: int,
    y: int,
    depth: Float32[np.ndarray, "h w"],
    camera: Float[np.ndarray, "3 3"],
    point: Float[np.ndarray, "3"],
) -> None:
    """Fill the point (m) that a pixel shows, as `geometry.back_project` computes it."""
    z = float(depth[y, x])
    point[0] = (x - camera[0, 2]) / camera[0, 0] * z
    point[1] = (y - camera[1, 2]) / camera[1, 1] * z
    point[2] = z


@compiled()
def sum_color_differences(
    observed: Float32[np.ndarray, "p 3"],
    points: Float[np.ndarray, "p 3"],
    light: Float[np.ndarray, "p 4"],
    motions: Float[np.ndarray, "n 4 4"],
    colors: UInt8[np.ndarray, "x y z 3"],
    corner: Float[np.ndarray, "3"],
    cell: float,
    logarithms: Float32[np.ndarray, "256"],
    limit: float,
    white_balance: float,
    differences: Float[np.ndarray, "n"],
) -> None:
    """Fill the mean squared difference of the colours for each motion; see `texture`.

    `observed` are the image's colours as logarithms, `points` where the pixels' rays meet the
    object (m), `colors`, `corner` and `cell` a `ColorGrid` that is read at the moved points,
    `logarithms` those of its values. The columns of `light` are orthonormal; what of the mean over
    the channels they explain is light. The rest and each channel's deviation count up to `limit`;
    `white_balance` is the weight of the channels' mean deviations.
    """
    count = len(points)
    difference = np.empty((count, 4))
    shading = np.empty(light.shape[1])
    mean = np.empty(3)
    limit_squared = limit * limit
    for n in range(len(motions)):
        _subtract_colors(observed, points, motions[n], colors, corner, cell, logarithms, difference)
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


@compiled(inline="always")
def _subtract_colors(
    observed: Float32[np.ndarray, "p 3"],
    points: Float[np.ndarray, "p 3"],
    motion: Float[np.ndarray, "4 4"],
    colors: UInt8[np.ndarray, "x y z 3"],
    corner: Float[np.ndarray, "3"],
    cell: float,
    logarithms: Float32[np.ndarray, "256"],
    difference: Float[np.ndarray, "p 4"],
) -> None:
    """Fill the channels' differences from their mean, and the mean itself in the last column."""
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
