"""Rendered RGB-D scenes with and without an object, on which the score of its poses is calibrated.

The object stands on a plane or hangs in the air, in any pose that its views show, among shapes of
its size. Some of them hide part of it; some are the object itself, stretched. One without colours
often lies on a side and is seen from above, with more of it, packed or apart, and in a bin. What a
CAD model does not tell is drawn at random: light, colours, registration of the images, errors of
the sensor and of the model's size.
"""

from collections.abc import Sequence
from dataclasses import replace

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from hlp.arrays import CameraMatrix, Image, Mask, Pose, Rgb
from hlp.geometry import back_project, rigid, transform
from hlp.method.learn import calibration_bins as bins
from hlp.objects.shapes import CUBE, hull_mesh
from hlp.patches.backgrounds import procedural_backgrounds
from hlp.records import Frame, Mesh, ObjectModel, Target
from hlp.rendering.rasterizer import render_depth, render_scene
from hlp.rendering.sensor import Kinect, noisy_depth, noisy_rgb
from hlp.rendering.shading import random_light
from hlp.rendering.views import ViewsSettings, view_rotations

_SHAPE = (480, 640)  # px: height, width
_FOCAL = (500.0, 620.0)  # px
_DISTANCE = (0.45, 1.0)  # m from the camera to the object's centroid, at least 3 diameters
_THINGS = (4, 9)  # other shapes in a scene
_NOISE = (1.0, 2.5)  # times a Kinect's
_EDGE_JITTER = 3  # px, at most
_LOST_EDGE = 3  # px without depth on each side of a jump in depth, at most
_JUMP = 0.02  # relative difference that is a jump
_WARP = 0.003  # m at 1 m: depth that is off smoothly, standard deviation
_MODEL_ERROR = 0.02  # of its size in each direction: no product is its model
_VISIBLE = 0.3  # of the object, at least
_ATTEMPTS = 4
_LYING, _BINS = 2, 4  # every so many scenes: the object lies on a face, with more of it; in a bin

Images = tuple[Rgb, Image]
"""Colour, and depth (m)."""
Parts = list[tuple[Mesh, Pose]]


def calibration_scene(
    model: ObjectModel,
    present: bool,
    views: ViewsSettings,
    frames: Sequence[Frame],
    number: int,
    seed: int,
) -> Frame:
    """Scene `number` with the object if it is `present`, in a pose that `views` cover.

    Every other scene has one of the `frames` as background, if there are any. At least three tenths
    of the object are visible. Deterministic.
    """
    for attempt in range(_ATTEMPTS):
        rng = np.random.default_rng([seed, number, int(present), attempt])
        frame = _random_scene(model, present, views, frames, number, rng)
        if not present or (frame.targets and frame.targets[0].visible_fraction >= _VISIBLE):
            return frame
    return replace(frame, targets=())  # hidden: not to be found


def _random_scene(
    model: ObjectModel,
    present: bool,
    views: ViewsSettings,
    frames: Sequence[Frame],
    number: int,
    rng: np.random.Generator,
) -> Frame:
    behind: Images | None = None
    if frames and number % 2:
        frame = frames[int(rng.integers(len(frames)))]
        behind, camera_matrix = (frame.rgb, frame.depth.astype(np.float32)), frame.camera_matrix
        shape = (frame.depth.shape[0], frame.depth.shape[1])
    else:
        focal, shape = rng.uniform(*_FOCAL), _SHAPE
        x, y = shape[1] / 2, shape[0] / 2
        camera_matrix = np.array([[focal, 0.0, x], [0.0, focal, y], [0.0, 0.0, 1.0]])
    pose = _random_pose(model, views, camera_matrix, shape, rng)
    in_bins = not model.mesh.colored
    plane, lies = _random_plane(model, pose, rng), in_bins and number % _LYING == 0
    if lies:
        pose, plane = bins.lying(model, pose, rng)
    parts = _things(model, pose, plane, rng) + _occluders(model, pose, rng)
    own: Parts = []
    if present:
        mesh = bins.with_random_color(_inexact(model, rng), rng)
        own = [(mesh, pose), *(bins.copies(mesh, model, pose, plane, rng) if lies else [])]
    parts = [*own, *parts]
    if in_bins and behind is None and number % _BINS == 0:
        parts += bins.bin_walls(model, bins.center_of(model, pose), plane, rng)
    rgb, depth, index = render_scene(parts, camera_matrix, shape, random_light(rng))
    if behind is None:
        behind = _draw_plane(plane, camera_matrix, shape, rng)
    nearer = (index < 0) | ((behind[1] > 0.0) & (behind[1] < depth))
    rgb[nearer], depth[nearer] = behind[0][nearer], behind[1][nearer]
    shown = np.where(nearer, -1, index)
    targets = tuple(_target(model, at, camera_matrix, shown == i) for i, (_, at) in enumerate(own))
    rgb, depth = _sensed(rgb, depth, float(camera_matrix[0, 0]), rng)
    return Frame(0, number, rgb, depth, camera_matrix, targets)


def _target(model: ObjectModel, pose: Pose, camera_matrix: CameraMatrix, shown: Mask) -> Target:
    """The object in a pose, given the pixels that show it."""
    size = (shown.shape[0], shown.shape[1])
    alone = render_depth(model.proxy, pose[None], camera_matrix, size, threads=1)[0]
    visible = np.count_nonzero(shown) / max(int(np.count_nonzero(alone)), 1)
    return Target(model.object_id, pose, min(1.0, visible))


def _random_pose(
    model: ObjectModel,
    views: ViewsSettings,
    camera_matrix: CameraMatrix,
    shape: tuple[int, int],
    rng: np.random.Generator,
) -> Pose:
    direction = rng.normal(size=3)
    if views.coverage == "hemisphere":
        direction[2] = abs(direction[2])
    roll = np.deg2rad(rng.uniform(views.in_plane_min_deg, views.in_plane_max_deg))
    rotation = view_rotations(direction[None], np.array([roll]))[0]
    nearest = max(_DISTANCE[0], 3.0 * model.diameter)
    distance = np.exp(rng.uniform(np.log(nearest), np.log(max(_DISTANCE[1], 1.5 * nearest))))
    pixel = rng.uniform(0.2, 0.8, 2) * np.array([shape[1], shape[0]])
    center = back_project(pixel, np.asarray(distance), camera_matrix)
    return rigid(rotation, center - rotation @ model.centroid)


def _random_plane(model: ObjectModel, pose: Pose, rng: np.random.Generator) -> bins.Plane:
    """A plane facing the camera that the object touches or hangs above."""
    center = bins.center_of(model, pose)
    toward_camera = -center / np.linalg.norm(center)
    while True:
        normal = Rotation.from_rotvec(rng.normal(0.0, 0.7, 3)).apply(toward_camera)
        if normal @ toward_camera > 0.3:  # up to 72° from the line of sight
            break
    points = transform(pose, model.proxy.vertices)
    gap = rng.uniform(0.0, 0.3) if rng.random() < 0.3 else 0.0
    return normal, float((points @ normal).min() - gap)


def _things(model: ObjectModel, pose: Pose, plane: bins.Plane, rng: np.random.Generator) -> Parts:
    """Shapes that stand on the plane around the object's place."""
    (normal, offset), center, parts = plane, bins.center_of(model, pose), []
    for _ in range(int(rng.integers(_THINGS[0], _THINGS[1] + 1))):
        mesh = _random_thing(model, rng)
        turn = Rotation.random(random_state=rng).as_matrix()
        away = rng.normal(size=3)
        away -= (away @ normal) * normal
        away *= model.diameter * rng.uniform(1.0, 4.0) / np.linalg.norm(away)
        place = center + away
        lowest = (mesh.vertices @ turn.T @ normal).min()
        parts.append((mesh, rigid(turn, place + (offset - place @ normal - lowest) * normal)))
    return parts


def _occluders(model: ObjectModel, pose: Pose, rng: np.random.Generator) -> Parts:
    """None, one or two shapes in front of a part of the object's place."""
    center, parts = bins.center_of(model, pose), []
    for _ in range(int(rng.choice([0, 1, 2], p=[0.65, 0.3, 0.05]))):
        mesh = _random_thing(model, rng)
        size = float(np.linalg.norm(np.ptp(mesh.vertices, axis=0))) / 2
        side = rng.normal(size=3)
        side *= (0.4 * model.diameter + rng.uniform(0.2, 1.0) * size) / np.linalg.norm(side)
        nearer = 1.0 - (model.diameter + size) * rng.uniform(0.8, 1.6) / center[2]
        place = (center + side) * max(nearer, 0.4)
        parts.append((mesh, rigid(Rotation.random(random_state=rng).as_matrix(), place)))
    return parts


def _random_thing(model: ObjectModel, rng: np.random.Generator) -> Mesh:
    """A convex shape about the origin, or the object stretched until it is another one."""
    if rng.random() < 0.05:
        stretch = np.exp(rng.permutation([0.35, -0.35, 0.0]) * rng.choice([-1.0, 1.0]))
        return replace(model.proxy, vertices=(model.proxy.vertices - model.centroid) * stretch)
    kind = int(rng.integers(3))
    if kind == 0:
        points = CUBE * 0.5
    elif kind == 1:
        angle = np.arange(24) * (2 * np.pi / 24)
        circle = 0.5 * np.column_stack([np.cos(angle), np.sin(angle)])
        top = rng.uniform(0.3, 1.0)
        low = np.column_stack([circle, np.full(24, -0.5)])
        points = np.concatenate([low, np.column_stack([circle * top, np.full(24, 0.5)])])
    else:
        points = rng.normal(size=(60, 3))
        points *= 0.5 / np.linalg.norm(points, axis=1, keepdims=True)
    size = model.diameter * np.exp(rng.uniform(np.log(0.15), np.log(2.0), 3))
    return _painted(hull_mesh(points * size, np.zeros(3, np.uint8)), model, rng)


def _painted(mesh: Mesh, model: ObjectModel, rng: np.random.Generator) -> Mesh:
    """A shape in one or two colours, the object's own at times."""
    if rng.random() < 0.3:
        palette = model.mesh.colors[rng.integers(len(model.mesh.colors), size=2)].astype(float)
    else:
        palette = np.clip(rng.uniform(20, 230) + rng.normal(0.0, 45.0, (2, 3)), 5, 250)
    along = mesh.vertices @ rng.normal(size=3)
    colors = palette[(along > np.quantile(along, rng.uniform(0.3, 1.0))).astype(int)]
    return replace(mesh, colors=colors.astype(np.uint8))


def _inexact(model: ObjectModel, rng: np.random.Generator) -> Mesh:
    """The object's mesh, stretched a little."""
    stretch = 1.0 + rng.normal(0.0, _MODEL_ERROR, 3)
    vertices = model.centroid + (model.mesh.vertices - model.centroid) * stretch
    return replace(model.mesh, vertices=vertices)


def _draw_plane(
    plane: bins.Plane, camera_matrix: CameraMatrix, shape: tuple[int, int], rng: np.random.Generator
) -> Images:
    """The plane, and a wall where the plane is farther away than that."""
    (normal, offset), (height, width) = plane, shape
    y, x = np.mgrid[0.0:height, 0.0:width]
    rays = back_project(np.stack([x, y], axis=-1), np.ones(shape), camera_matrix)
    wall = rng.uniform(1.3, 3.0)
    with np.errstate(divide="ignore"):
        depth = offset / (rays @ normal)
    depth = np.where((depth > 0.0) & (depth < wall), depth, wall).astype(np.float32)
    small = procedural_backgrounds(2, 160, rng)
    table, beyond = (cv2.resize(i, (width, height), interpolation=cv2.INTER_LINEAR) for i in small)
    rgb = np.where((depth < wall)[..., None], table, beyond)
    return np.asarray(rgb, dtype=np.uint8), depth


def _sensed(rgb: Rgb, depth: Image, focal: float, rng: np.random.Generator) -> Images:
    """The images of a real camera: noise, wandering edges and a depth that is off smoothly.

    Colours have another saturation and black level, and are shifted by up to 2 px.
    """
    sensor = Kinect(float(rng.uniform(*_NOISE)), int(rng.integers(1, _EDGE_JITTER + 1)))
    grey = rgb.mean(axis=2, keepdims=True)
    colors = grey + (rgb - grey) * rng.uniform(0.5, 1.1) + rng.uniform(0.0, 25.0)
    shift = np.array([[1.0, 0.0, rng.uniform(-2, 2)], [0.0, 1.0, rng.uniform(-2, 2)]])
    size = (rgb.shape[1], rgb.shape[0])
    clipped = np.clip(colors, 0, 255).astype(np.uint8)
    moved = cv2.warpAffine(clipped, shift, size, borderMode=cv2.BORDER_REPLICATE)
    grid = rng.normal(0.0, _WARP, (12, 16)).astype(np.float32)
    warp = cv2.resize(grid, size, interpolation=cv2.INTER_CUBIC)
    warped = np.where(depth > 0.0, depth + warp * depth * depth, depth).astype(np.float32)
    read = noisy_depth(warped, focal, rng, sensor)
    read[_near_jumps(depth, int(rng.integers(0, _LOST_EDGE + 1)))] = 0.0
    return noisy_rgb(np.asarray(moved), rng, sensor), read


def _near_jumps(depth: Image, radius: int) -> Mask:
    """Pixels up to `radius` px from one side of a jump in depth; none for a radius of 0."""
    window = np.ones((2 * radius + 1, 2 * radius + 1), np.uint8)
    return np.asarray(cv2.dilate(depth, window) - cv2.erode(depth, window) > _JUMP * depth)
