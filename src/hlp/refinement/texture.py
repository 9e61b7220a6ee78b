"""Which of the poses that depth cannot tell apart the colours of an image agree with best.

The poses T·S of an object whose shape the motions S (`ObjectModel.near_symmetries`) leave nearly as
it is show the same surface with other colours. So the surface is drawn once, and the colours of
each are read where its motion takes the surface points, from a grid filled by the full texture.
Colours are compared as logarithms, after light, shading and white balance were fitted; differences
count up to a limit, because highlights and occluders are not in the texture.
"""

from dataclasses import replace
from typing import NamedTuple

import cv2
import numpy as np
from jaxtyping import Float, Float32, UInt8

from hlp.arrays import Image, Point, Points, Pose, Poses, Rgb, Values
from hlp.geometry import (
    inverse,
    project,
    quaternions,
    rigid,
    rotation_distance,
    rotation_matrices,
    transform,
)
from hlp.kernels import compiled, compiled_ahead
from hlp.records import ObjectModel
from hlp.refinement.verification import Observation
from hlp.rendering.rasterizer import NEAR, render_depth
from hlp.rendering.surface import color_grid, surface_and_normals

_SIZE = 128  # long side (px) of the compared region; not blurred, which would lose small print
_TOLERANCE = 0.02  # m; pixels whose depth differs by more show something else
_OFFSET = 20.0  # of 255, added to colours, because the logarithm of dark ones is mostly noise
_LIMIT = 0.3  # of a difference of logarithms
_WHITE_BALANCE = 0.3  # weight of the fitted white balance: colours matter where nothing is printed
_MIN_PIXELS = 40
_STEP = np.radians(7.0)  # those nearer than this are steps about a continuous axis
_NEAR = np.radians(30.0)  # how far an object may turn between two frames of a sequence
_PARTS = np.array([0.0, -0.6, -0.4, -0.2, 0.2, 0.4, 0.6])  # of such a step


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


class ColorAgreement(NamedTuple):
    """How well an image's colours agree with those of the object at a pose.

    `correlation` in [-1, 1] compares, pixel by pixel, chroma (the colours' logarithms minus their
    mean) and brightness after light and shading were fitted. It is not about the mean: a red
    object agrees with anything red. `contrast` is the root mean square of the same for the
    object: 0 for a grey one without print. Both are 0 if there is nothing to compare.
    """

    correlation: float = 0.0
    contrast: float = 0.0


def choose_by_texture(observation: Observation, model: ObjectModel, pose_cam_obj: Pose) -> Pose:
    """The pose, or that of its near symmetries whose colours agree best with the image.

    About a continuous axis the angle is refined to 1°. The pose stays if the object has no
    near symmetries, or if fewer than 40 pixels show it.
    """
    if len(model.near_symmetries) == 0:
        return pose_cam_obj
    return _choose(_seen_surface(observation, model, pose_cam_obj), model, pose_cam_obj)


def choose_nearby_by_texture(
    observation: Observation, model: ObjectModel, pose_cam_obj: Pose
) -> Pose:
    """What `choose_by_texture` chooses, among the poses less than 30° away.

    For an object that is tracked: it may have turned a little about an axis that depth hardly
    tells, but not by half a turn.
    """
    angles = rotation_distance(model.near_symmetries[:, :3, :3], np.eye(3))
    near = replace(model, near_symmetries=model.near_symmetries[angles < _NEAR])
    if len(near.near_symmetries) == 0:
        return pose_cam_obj
    seen = _seen_surface(observation, model, pose_cam_obj, every_other=True)
    return _choose(seen, near, pose_cam_obj)


def _choose(seen: SeenSurface | None, model: ObjectModel, pose_cam_obj: Pose) -> Pose:
    if seen is None:
        return pose_cam_obj
    motions = np.concatenate([np.eye(4)[None], model.near_symmetries])
    best = int(np.argmin(_differences(seen, model, motions)))
    fine = _parts_of_step(motions, best)
    return np.asarray(pose_cam_obj @ fine[int(np.argmin(_differences(seen, model, fine)))])


def color_agreement(
    observation: Observation, model: ObjectModel, pose_cam_obj: Pose
) -> ColorAgreement:
    """How well the image's colours agree with the object's full texture at a pose."""
    seen = _seen_surface(observation, model, pose_cam_obj) if model.mesh.colored else None
    if seen is None:
        return ColorAgreement()
    grid = color_grid(model.mesh)
    cells = np.floor((seen.points - grid.corner) / grid.cell).astype(np.int64)
    x, y, z = np.clip(cells, 0, np.array(grid.colors.shape[:3]) - 1).T
    expected = np.log(grid.colors[x, y, z] + np.float32(_OFFSET))
    first, second = (_without_light(colors, seen.light) for colors in (seen.colors, expected))
    spread = np.sqrt(float((first * first).sum()) * float((second * second).sum()))
    contrast = float(np.sqrt(np.square(second).sum(axis=1).mean()))
    if spread <= 0.0:
        return ColorAgreement(0.0, contrast)
    return ColorAgreement(float((first * second).sum()) / spread, contrast)


def _without_light(
    colors: Float32[np.ndarray, "p 3"], light: Float[np.ndarray, "p 4"]
) -> Float[np.ndarray, "p 4"]:
    """Chroma of each pixel, and what of its brightness is neither light nor shading."""
    brightness = colors.mean(axis=1, keepdims=True, dtype=np.float64)
    rest = brightness - light @ (light.T @ brightness)
    return np.concatenate([colors - brightness, rest], axis=1)


def _parts_of_step(motions: Poses, best: int) -> Poses:
    """The best motion and, where others are a step of an axis away, turns by parts of the step."""
    apart = rotation_distance(motions[:, :3, :3], motions[best, :3, :3])
    beside = int(np.argmin(np.where(apart > 1e-6, apart, np.inf)))
    if not 1e-6 < apart[beside] < _STEP:
        return motions[best : best + 1]
    step = motions[beside] @ inverse(motions[best])
    quat = quaternions(step[:3, :3])
    sine = float(np.linalg.norm(quat[:3]))
    axis = quat[:3] / np.copysign(sine, quat[3])
    half = _PARTS * np.arctan2(sine, abs(quat[3]))
    turns = rotation_matrices(np.column_stack([np.sin(half)[:, None] * axis, np.cos(half)]))
    point = np.linalg.solve(np.eye(3) - step[:3, :3] + np.outer(axis, axis), step[:3, 3])
    return np.asarray(rigid(turns, point - turns @ point) @ motions[best])


def _differences(seen: SeenSurface, model: ObjectModel, motions: Poses) -> Values:
    """Mean squared difference of the colours' logarithms for the pose after each motion."""
    grid = color_grid(model.mesh)
    logarithms = np.log(np.arange(256, dtype=np.float32) + np.float32(_OFFSET))
    with_logarithms = LogarithmGrid(grid.colors, grid.corner, grid.cell, logarithms)
    # The pixel that shows x at a pose T shows S⁻¹ x at T·S.
    back = np.ascontiguousarray(inverse(motions))
    return sum_color_differences(seen, back, with_logarithms, _LIMIT, _WHITE_BALANCE)


def _seen_surface(
    observation: Observation, model: ObjectModel, pose_cam_obj: Pose, every_other: bool = False
) -> SeenSurface | None:
    """What the image shows of the object; None if that is too little.

    The decimated mesh is 0.4 mm off and drawn in no time. With `every_other` pixel, like the white
    squares of a chessboard, it takes half the time.
    """
    crop = _crop(observation, model, pose_cam_obj)
    if crop is None:
        return None
    rgb, depth, camera = crop
    rendered = render_depth(model.proxy, pose_cam_obj[None], camera, depth.shape, 1)[0]
    drawn = rendered > 0.0
    inner = cv2.erode(drawn.view(np.uint8), np.ones((3, 3), np.uint8)) > 0
    used = inner & (depth > 0.0) & (np.abs(depth - rendered) < _TOLERANCE)
    if every_other:
        used[::2, ::2] = used[1::2, 1::2] = False
    count = int(np.count_nonzero(used))
    if count < _MIN_PIXELS:
        return None
    surface, normals = surface_and_normals(rendered, used, count, camera)
    light, _ = np.linalg.qr(np.concatenate([np.ones((count, 1)), normals], axis=1))
    points = transform(inverse(pose_cam_obj), surface)
    colors = np.log(rgb[used] + np.float32(_OFFSET))
    return SeenSurface(colors, points, np.ascontiguousarray(light))


def _crop(
    observation: Observation, model: ObjectModel, pose_cam_obj: Pose
) -> tuple[Rgb, Image, Float[np.ndarray, "3 3"]] | None:
    """Colour, depth and intrinsics of the object's bounding box, at most 128 px on a side."""
    points = transform(pose_cam_obj, model.proxy.vertices)
    if points[:, 2].min() <= NEAR:
        return None
    height, width = observation.depth.shape
    pixels = project(points, observation.camera_matrix)
    first = np.clip(np.floor(pixels.min(axis=0)).astype(int) - 2, 0, None)
    last = np.clip(np.ceil(pixels.max(axis=0)).astype(int) + 3, 0, (width, height))
    if (last - first).min() < 3:
        return None
    stride = int(np.ceil((last - first).max() / _SIZE))
    area = (slice(first[1], last[1]), slice(first[0], last[0]))
    rgb, depth = observation.rgb[area], observation.depth[area][::stride, ::stride]
    if stride > 1:
        rgb = cv2.blur(rgb, (stride, stride))[::stride, ::stride]
    camera = observation.camera_matrix.astype(np.float64)
    camera[:2, 2] -= first
    camera[:2] /= stride
    return np.ascontiguousarray(rgb), np.ascontiguousarray(depth), camera


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
