"""Table, floor and wall of a demo scene, by intersecting the rays of pixels with planes."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
from jaxtyping import Float

from hlp.arrays import CameraMatrix, Flags, Image, Points, Pose, Positions, Rgb, Values, Vector
from hlp.data.synthetic.layout import Item
from hlp.geometry import inverse, rigid
from hlp.objects.shapes import merge, moved_by
from hlp.records import Mesh
from hlp.rendering.rasterizer import render_depth
from hlp.rendering.shading import Light

MAP_SIDE, MAP_PIXELS = 2.4, 600
"""Side (m and px) of the square maps of texture and shadow, centred on the table."""
_FLOOR = -0.72  # height (m)
_FARTHEST = 6.0  # depth (m)
_UP = np.array([0.0, 0.0, 1.0])
_FOLD = 1024


@dataclass(frozen=True)
class Surroundings:
    """A table of half size (x, y) and yaw (rad), the floor, and a wall behind the table.

    The wall is `wall_distance` (m) from the table's middle; if that is infinite there is no wall,
    and the floor ends at the maximum depth. `wall_normal` is horizontal and points to the camera.
    Table, floor and wall each have a colour (0…255) and a texture, a map of its brightness.
    """

    half_size: Float[np.ndarray, "2"]
    yaw: float
    wall_distance: float
    wall_normal: Vector
    colors: Float[np.ndarray, "3 3"]
    textures: Float[np.ndarray, "3 m m"]


def random_surroundings(azimuth: float, rng: np.random.Generator) -> Surroundings:
    """Random surroundings for a camera at an azimuth (rad); two of three have a wall opposite."""
    turn = azimuth + rng.uniform(-0.7, 0.7)
    far = rng.uniform(0.75, 1.6) if rng.uniform() < 0.67 else np.inf
    return Surroundings(
        half_size=rng.uniform(0.5, 1.0, 2),
        yaw=rng.uniform(0.0, np.pi),
        wall_distance=float(far),
        wall_normal=np.array([np.cos(turn), np.sin(turn), 0.0]),
        colors=rng.uniform(70.0, 200.0, (3, 1)) + rng.normal(0.0, 14.0, (3, 3)),
        textures=np.stack([_random_texture(rng) for _ in range(3)]),
    )


def draw_surroundings(
    surroundings: Surroundings,
    items: Sequence[Item],
    pose_cam_world: Pose,
    camera_matrix: CameraMatrix,
    shape: tuple[int, int],
    light: Light,
) -> tuple[Rgb, Image]:
    """Colour and depth (m, 0 = nothing) of the surfaces, with the items' shadows on the table."""
    pose_world_cam = inverse(pose_cam_world)
    rays = _rays(camera_matrix, shape) @ pose_world_cam[:3, :3].T.astype(np.float32)
    eye = pose_world_cam[:3, 3].astype(np.float32)
    toward_light = pose_world_cam[:3, :3] @ np.array(light.direction)
    rgb = np.full((len(rays), 3), 96, dtype=np.uint8)
    depth = np.zeros(len(rays), dtype=np.float32)
    wall = (surroundings.wall_normal, -surroundings.wall_distance)
    left = np.arange(len(rays))
    # A pixel shows the first surface in this order that its ray meets in front of the wall.
    for number, (normal, offset) in enumerate([(_UP, 0.0), (_UP, _FLOOR), wall]):
        ray_depth, points = _intersect_plane(eye, rays[left], normal.astype(np.float32), offset)
        hit = (ray_depth > 0.0) & (ray_depth < _FARTHEST)
        if number < 2:
            hit &= points @ surroundings.wall_normal.astype(np.float32) > wall[1]
        if number == 0:
            hit &= _on_table(points, surroundings)
        points, seen = points[hit], left[hit]
        bright = light.ambient + light.diffuse * max(0.0, float(normal @ toward_light))
        places = points[:, 1:] if number == 2 else points[:, :2]
        lit = _sample_map(surroundings.textures[number], places) * bright
        if number == 0:
            lit *= 1.0 - _shadows(items, toward_light, places, 1.0 - light.ambient / bright)
        color = lit[:, None] * surroundings.colors[number].astype(np.float32)
        rgb[seen] = np.clip(color, 0, 255).astype(np.uint8)
        depth[seen] = ray_depth[hit]
        left = left[~hit]
    return rgb.reshape(*shape, 3), depth.reshape(shape)


def _intersect_plane(
    eye: Vector, rays: Points, normal: Vector, offset: float
) -> tuple[Values, Points]:
    """Depth (m, 0 = none) and world point where rays meet the plane normal·x = offset."""
    with np.errstate(divide="ignore", invalid="ignore"):
        ray_depth = np.float32(offset - eye @ normal) / (rays @ normal)
    ray_depth = np.where(np.isfinite(ray_depth), ray_depth, np.float32(0.0))
    return ray_depth, eye + rays * ray_depth[:, None]


def _rays(camera_matrix: CameraMatrix, shape: tuple[int, int]) -> Points:
    """The ray of each pixel, row by row, with z = 1."""
    rays = np.ones((*shape, 3), dtype=np.float32)
    rays[..., 0] = (np.arange(shape[1]) - camera_matrix[0, 2]) / camera_matrix[0, 0]
    rays[..., 1] = ((np.arange(shape[0]) - camera_matrix[1, 2]) / camera_matrix[1, 1])[:, None]
    return rays.reshape(-1, 3)


def _on_table(points: Points, surroundings: Surroundings) -> Flags:
    cos, sin = np.float32(np.cos(surroundings.yaw)), np.float32(np.sin(surroundings.yaw))
    along = np.abs(cos * points[:, 0] + sin * points[:, 1])
    across = np.abs(cos * points[:, 1] - sin * points[:, 0])
    return np.asarray((along < surroundings.half_size[0]) & (across < surroundings.half_size[1]))


def _sample_map(picture: Float[np.ndarray, "m m"], places: Positions) -> Values:
    """Values of a map at places (m) relative to its middle; it is mirrored beyond its border."""
    if len(places) == 0:
        return np.zeros(0, dtype=np.float32)
    pixels = places * np.float32(MAP_PIXELS / MAP_SIDE) + np.float32(MAP_PIXELS / 2)
    # OpenCV is limited to 32767 rows, so the list is folded into columns.
    rows = -(-len(pixels) // _FOLD)
    folded = np.zeros((rows * _FOLD, 2), dtype=np.float32)
    folded[: len(pixels)] = pixels
    x, y = folded.reshape(rows, _FOLD, 2).transpose(2, 0, 1).copy()
    values = cv2.remap(picture, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REFLECT)
    return np.asarray(values.reshape(-1)[: len(pixels)])


def _random_texture(rng: np.random.Generator) -> Float[np.ndarray, "m m"]:
    """Random brightness around 1: coarse and fine noise, stretched in one direction at times."""
    texture = np.ones((MAP_PIXELS, MAP_PIXELS), dtype=np.float32)
    stretch = int(rng.choice([1, 1, 6]))
    for cells, strength in ((5, 0.10), (18, 0.06), (90, 0.04), (300, 0.03)):
        grid = rng.normal(0.0, strength, (cells, max(2, cells // stretch))).astype(np.float32)
        texture += cv2.resize(grid, (MAP_PIXELS, MAP_PIXELS), interpolation=cv2.INTER_LINEAR)
    return texture


def _shadows(
    items: Sequence[Item], toward_light: Vector, places: Positions, direct: float
) -> Values:
    """Share of the light that is missing at places on the table.

    It is `direct` in the shadows of items; near and below items some ambient light is missing, too.
    """
    things = merge(*(moved_by(item.coarse, item.pose_world_obj) for item in items))
    slant = toward_light / toward_light[2]
    cast = _seen_from_above(things, things.vertices - things.vertices[:, 2:] * slant)
    below = _seen_from_above(things, things.vertices * np.array([1.0, 1.0, 0.0]))
    sharp = cv2.GaussianBlur(cast, (0, 0), 1.5) * np.float32(direct)
    soft = cv2.GaussianBlur(below, (0, 0), 5.0) * np.float32(0.45)
    return _sample_map(np.minimum(sharp + soft, np.float32(0.9)), places)


def _seen_from_above(mesh: Mesh, flattened: Float[np.ndarray, "v 3"]) -> Float[np.ndarray, "m m"]:
    """Map of where a mesh, flattened onto the table, covers it (1) or not (0)."""
    scale = MAP_PIXELS / MAP_SIDE
    above = np.array([[scale, 0, MAP_PIXELS / 2], [0, scale, MAP_PIXELS / 2], [0, 0, 1.0]])
    pose = rigid(np.eye(3), np.array([0.0, 0.0, 1.0]))
    flat = replace(mesh, vertices=flattened)
    covered = render_depth(flat, pose[None], above, (MAP_PIXELS, MAP_PIXELS), threads=1)
    return np.asarray(covered[0] > 0.0, dtype=np.float32)
