"""Kernel of `texture`: how an image's colours differ from those on a seen surface."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Float32, UInt8

from hlp.arrays import Point, Points, Pose, Poses, Values
from hlp.kernels import compiled, compiled_ahead


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


@compiled_ahead()
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
