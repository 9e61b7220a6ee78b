"""Triangle z-buffer on the CPU (numba) without OpenGL: depth of many poses, or RGB-D of a scene.

Pixel centres have integer coordinates. 1/z is interpolated linearly in the image, which is exact
for planes. Both sides of a triangle are visible, because scanned meshes are not wound consistently.
Kernels are serial and release the GIL; threads render different poses. Surfaces are shaded under a
directional light (Blinn-Phong).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int, Int32, UInt8

from hlp.arrays import CameraMatrix, Image, Points, Pose, Poses, Rgb, Values, Vector
from hlp.geometry import transform
from hlp.kernels import ThreadTeam, compiled
from hlp.records import Mesh


@dataclass(frozen=True)
class Light:
    """A directional and an ambient light, both white.

    `direction` is the unit vector from the surface towards the light in camera coordinates (the
    camera looks along +z, so light from behind the camera has a negative z). `ambient`, `diffuse`
    and `specular` are strengths, 1 being the albedo itself (white for the specular one).
    """

    direction: tuple[float, float, float]
    ambient: float
    diffuse: float
    specular: float
    shininess: float


FRONTAL_LIGHT = Light((0.0, 0.0, -1.0), ambient=0.4, diffuse=0.6, specular=0.0, shininess=1.0)


def random_light(rng: np.random.Generator) -> Light:
    """A light from a random direction on the camera's side, with random strengths."""
    direction = rng.normal(size=3)
    direction /= np.linalg.norm(direction)
    direction[2] = -abs(direction[2])
    x, y, z = (float(value) for value in direction)
    return Light(
        direction=(x, y, z),
        ambient=float(rng.uniform(0.3, 0.9)),
        diffuse=float(rng.uniform(0.2, 0.9)),
        specular=float(rng.uniform(0.0, 0.4)),
        shininess=float(rng.uniform(5.0, 40.0)),
    )


@compiled()
def shade(albedo: Vector, normal: Vector, view: Vector, light: Values) -> tuple[int, int, int]:
    """Colour (0…255) of a surface point under a light as `_numbers` gives it (Blinn-Phong).

    `albedo` in 0…255, `normal` and `view` (from the surface towards the camera) in camera
    coordinates, of any length. Both sides of a surface are lit: a normal that points away from the
    camera is flipped, because normals of scanned meshes are unreliable.
    """
    nx, ny, nz = _unit(normal[0], normal[1], normal[2])
    vx, vy, vz = _unit(view[0], view[1], view[2])
    side = -1.0 if nx * vx + ny * vy + nz * vz < 0.0 else 1.0
    hx, hy, hz = _unit(vx + light[0], vy + light[1], vz + light[2])
    diffuse = max(side * (nx * light[0] + ny * light[1] + nz * light[2]), 0.0)
    highlight = 0.0
    if diffuse > 0.0 and light[5] > 0.0:
        halfway = max(side * (nx * hx + ny * hy + nz * hz), 0.0)
        highlight = 255.0 * light[5] * halfway ** light[6]
    lit = light[3] + light[4] * diffuse
    red, green, blue = albedo[0] * lit, albedo[1] * lit, albedo[2] * lit
    return _level(red + highlight), _level(green + highlight), _level(blue + highlight)


@compiled(inline="always")
def _level(color: float) -> int:
    return int(min(max(np.rint(color), 0.0), 255.0))


@compiled(inline="always")
def _unit(x: float, y: float, z: float) -> tuple[float, float, float]:
    """A vector scaled to unit length; one of length 0 stays 0."""
    length = np.sqrt(x * x + y * y + z * z)
    scale = 1.0 / length if length > 0.0 else 0.0
    return x * scale, y * scale, z * scale


def _numbers(light: Light) -> Values:
    """Direction (3), ambient, diffuse and specular strength, and shininess of a light."""
    strengths = light.ambient, light.diffuse, light.specular, light.shininess
    return np.array([*light.direction, *strengths])


NEAR = 0.01
"""Triangles with a corner nearer to the camera than this (m) are not drawn."""


@compiled()
def fill_triangles(
    corners: Points,
    faces: Int[np.ndarray, "f 3"],
    inverse_depth: Image,
    triangles: Int[np.ndarray, "h w"],
    first: int = 0,
) -> None:
    """Draw triangles into a z-buffer of inverse depths (1/m, 0 = nothing), keeping the nearest.

    `corners` are (x px, y px, 1/z) of each vertex; a vertex with 1/z <= 0 drops its triangles.
    `triangles` receives the index of the face seen at each pixel, counted from `first`. Edges
    belong to both triangles that share them, with a tolerance above the rounding error, so that
    they leave no gap.
    """
    height, width = inverse_depth.shape
    for face in range(faces.shape[0]):
        a, b, c = faces[face, 0], faces[face, 1], faces[face, 2]
        ax, ay, wa = corners[a, 0], corners[a, 1], corners[a, 2]
        bx, by, wb = corners[b, 0], corners[b, 1], corners[b, 2]
        cx, cy, wc = corners[c, 0], corners[c, 1], corners[c, 2]
        area = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)
        x0 = max(int(np.ceil(min(ax, bx, cx) - 1e-6)), 0)
        x1 = min(int(np.floor(max(ax, bx, cx) + 1e-6)), width - 1)
        y0 = max(int(np.ceil(min(ay, by, cy) - 1e-6)), 0)
        y1 = min(int(np.floor(max(ay, by, cy) + 1e-6)), height - 1)
        low, high = min(wa, wb, wc), max(wa, wb, wc)
        if x0 > x1 or y0 > y1 or abs(area) < 1e-12 or low <= 0.0:
            continue
        # Weights of corners b and c grow linearly from corner a; corner a has the rest.
        scale = 1.0 / area
        b_x, b_y = (cy - ay) * scale, (ax - cx) * scale
        c_x, c_y = (ay - by) * scale, (bx - ax) * scale
        tolerance = -1e-8 * abs(scale)
        for y in range(y0, y1 + 1):
            for x in range(x0, x1 + 1):
                weight_b = b_x * (x - ax) + b_y * (y - ay)
                weight_c = c_x * (x - ax) + c_y * (y - ay)
                least = min(min(weight_b, weight_c), 1.0 - weight_b - weight_c)
                # A pixel within the tolerance may lie outside a sliver: do not extrapolate there.
                w = min(max(wa + weight_b * (wb - wa) + weight_c * (wc - wa), low), high)
                # Without a branch, because mispredicted branches take longer than this arithmetic
                # (2.6 times as long, measured).
                nearest = (least >= tolerance) & (w > inverse_depth[y, x])
                inverse_depth[y, x] = w if nearest else inverse_depth[y, x]
                triangles[y, x] = first + face if nearest else triangles[y, x]


def render_depth(
    mesh: Mesh,
    poses_cam_obj: Poses,
    camera_matrix: CameraMatrix,
    shape: tuple[int, int],
    threads: int = 2,
) -> Float[np.ndarray, "n h w"]:
    """Depth along z (m, float32, 0 = nothing) of a mesh in each of n poses.

    Raises ValueError on a pose that is not finite.
    """
    poses_cam_obj = np.asarray(poses_cam_obj, dtype=np.float64)
    _require_finite(poses_cam_obj)
    depth = np.zeros((len(poses_cam_obj), *shape), dtype=np.float32)
    faces = drawn_faces(mesh)

    def draw(index: int) -> None:
        points = transform(poses_cam_obj[index], mesh.vertices)
        inverse_depth, triangles = _empty(shape)
        _draw(points, faces, camera_matrix, inverse_depth, triangles, 0)
        depth[index] = _depth(inverse_depth)

    ThreadTeam(threads).map(draw, len(depth))
    return depth


def render_rgbd(
    mesh: Mesh,
    pose_cam_obj: Pose,
    camera_matrix: CameraMatrix,
    shape: tuple[int, int],
    light: Light,
) -> tuple[Rgb, Image]:
    """Colour (black where nothing is) and depth (m, 0 = nothing) of one mesh in one pose."""
    rgb, depth, _ = render_scene([(mesh, pose_cam_obj)], camera_matrix, shape, light)
    return rgb, depth


def render_scene(
    parts: Sequence[tuple[Mesh, Pose]],
    camera_matrix: CameraMatrix,
    shape: tuple[int, int],
    light: Light,
) -> tuple[Rgb, Image, Int[np.ndarray, "h w"]]:
    """Colour, depth (m) and the index of the part seen at each pixel (-1 = nothing).

    `parts` are meshes with their poses, at least one, drawn into one z-buffer. Raises ValueError on
    a pose that is not finite.
    """
    poses = np.stack([np.asarray(pose, dtype=np.float64) for _, pose in parts])
    _require_finite(poses)
    inverse_depth, triangles = _empty(shape)
    drawn, first = [], 0
    for (mesh, _), pose in zip(parts, poses, strict=True):
        surface = _Surface(
            first,
            drawn_faces(mesh),
            transform(pose, mesh.vertices),
            mesh.normals,
            mesh.colors,
            np.ascontiguousarray(pose[:3, :3]),
        )
        _draw(surface.points_cam, surface.faces, camera_matrix, inverse_depth, triangles, first)
        drawn.append(surface)
        first += len(surface.faces)
    rgb = np.zeros((*shape, 3), dtype=np.uint8)
    index = np.full(shape, -1, dtype=np.int64)
    lit, camera = _numbers(light), np.asarray(camera_matrix, dtype=np.float64)
    for part, surface in enumerate(drawn):
        _shade_surface(surface, triangles, camera, lit, part, rgb, index)
    return rgb, _depth(inverse_depth), index


class _Surface(NamedTuple):
    """A placed mesh: number of its first face, its arrays, and its rotation to the camera."""

    first: int
    faces: Int32[np.ndarray, "f 3"]
    points_cam: Points
    normals: Points
    colors: UInt8[np.ndarray, "v 3"]
    rotation: Float[np.ndarray, "3 3"]


@lru_cache(maxsize=64)
def drawn_faces(mesh: Mesh) -> Int32[np.ndarray, "f 3"]:
    """The faces as kernels take them; kept for each of the meshes drawn last."""
    return np.ascontiguousarray(mesh.faces, dtype=np.int32)


def _empty(shape: tuple[int, int]) -> tuple[Image, Int32[np.ndarray, "h w"]]:
    """Inverse depth (0 = nothing) and face index (-1 = nothing)."""
    return np.zeros(shape), np.full(shape, -1, dtype=np.int32)


def _draw(
    points_cam: Points,
    faces: Int32[np.ndarray, "f 3"],
    camera_matrix: CameraMatrix,
    inverse_depth: Image,
    triangles: Int32[np.ndarray, "h w"],
    first: int,
) -> None:
    """Draw triangles in camera space, see `fill_triangles`."""
    z = points_cam[:, 2]
    inverse = np.where(z >= NEAR, 1.0 / np.where(z >= NEAR, z, 1.0), 0.0)
    corners = np.empty((len(points_cam), 3))
    corners[:, 0] = points_cam[:, 0] * inverse * camera_matrix[0, 0] + camera_matrix[0, 2]
    corners[:, 1] = points_cam[:, 1] * inverse * camera_matrix[1, 1] + camera_matrix[1, 2]
    corners[:, 2] = inverse
    fill_triangles(corners, faces, inverse_depth, triangles, first)


@compiled()
def _shade_surface(
    surface: _Surface,
    triangles: Int32[np.ndarray, "h w"],
    camera: CameraMatrix,
    light: Values,
    part: int,
    rgb: Rgb,
    index: Int[np.ndarray, "h w"],
) -> None:
    """Fill in the colours and the number of one part where its faces are seen."""
    height, width = triangles.shape
    albedo, normal, view = np.empty(3), np.empty(3), np.empty(3)
    last = surface.first + len(surface.faces)
    rotation, points, colors = surface.rotation, surface.points_cam, surface.colors
    for y in range(height):
        for x in range(width):
            if not surface.first <= triangles[y, x] < last:
                continue
            face = surface.faces[triangles[y, x] - surface.first]
            ray_x, ray_y = (x - camera[0, 2]) / camera[0, 0], (y - camera[1, 2]) / camera[1, 1]
            weights = _corner_weights(points, face, ray_x, ray_y)
            own = np.zeros(3)
            albedo[:], view[:] = 0.0, 0.0
            for k in range(3):
                for axis in range(3):
                    albedo[axis] += weights[k] * colors[face[k], axis]
                    view[axis] -= weights[k] * points[face[k], axis]
                    own[axis] += weights[k] * surface.normals[face[k], axis]
            for axis in range(3):
                turned = rotation[axis, 0] * own[0] + rotation[axis, 1] * own[1]
                normal[axis] = turned + rotation[axis, 2] * own[2]
            rgb[y, x, 0], rgb[y, x, 1], rgb[y, x, 2] = shade(albedo, normal, view, light)
            index[y, x] = part


@compiled(inline="always")
def _corner_weights(
    points_cam: Points, face: Int32[np.ndarray, "3"], ray_x: float, ray_y: float
) -> tuple[float, float, float]:
    """Perspective-correct weights of a face's corners where a pixel's ray (x, y, 1) meets it."""
    a, b, c = points_cam[face[0]], points_cam[face[1]], points_cam[face[2]]
    # The ray's three volumes with the edges, one for the corner opposite to each edge.
    u, v, w = _volume(b, c, ray_x, ray_y), _volume(c, a, ray_x, ray_y), _volume(a, b, ray_x, ray_y)
    side = np.sign(u + v + w)
    u, v, w = max(u * side, 0.0), max(v * side, 0.0), max(w * side, 0.0)
    total = u + v + w
    if total == 0.0:  # seen from its very edge
        return 1.0, 0.0, 0.0
    return u / total, v / total, w / total


@compiled(inline="always")
def _volume(start: Vector, end: Vector, ray_x: float, ray_y: float) -> float:
    """Six times the volume between a ray (x, y, 1) and an edge."""
    cross_x = start[1] * end[2] - start[2] * end[1]
    cross_y = start[2] * end[0] - start[0] * end[2]
    cross_z = start[0] * end[1] - start[1] * end[0]
    return float(cross_x * ray_x + cross_y * ray_y + cross_z)


def _depth(inverse_depth: Image) -> Image:
    drawn = inverse_depth > 0.0
    depth = np.zeros(inverse_depth.shape, dtype=np.float32)
    depth[drawn] = 1.0 / inverse_depth[drawn]
    return depth


def _require_finite(poses_cam_obj: Poses) -> None:
    bad = ~np.isfinite(poses_cam_obj).all(axis=(-2, -1))
    if bad.any():
        raise ValueError(f"poses_cam_obj[{int(np.flatnonzero(bad)[0])}] is not finite (nan or inf)")
