"""Triangle z-buffer on the CPU (numba) without OpenGL: depth of many poses, or RGB-D of a scene.

Pixel centres have integer coordinates. 1/z is interpolated linearly in the image, which is exact
for planes. Both sides of a triangle are visible, because scanned meshes are not wound consistently.
Kernels are serial and release the GIL; threads render different poses. Surfaces are shaded under a
directional light (Blinn-Phong).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int, UInt8

from hlp.arrays import CameraMatrix, Image, Pixels, Points, Pose, Poses, Rgb
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


def shade(
    albedo: Points | UInt8[np.ndarray, "n 3"],
    normals: Points,
    view_directions: Points,
    light: Light,
) -> UInt8[np.ndarray, "n 3"]:
    """Colours (0…255) of surface points under a light (Blinn-Phong).

    `albedo` in 0…255, `normals` and `view_directions` (from the surface towards the camera) in
    camera coordinates, of any length. Both sides of a surface are lit: a normal that points away
    from the camera is flipped, because normals of scanned meshes are unreliable.
    """
    normals, view = _unit(normals), _unit(view_directions)
    facing = np.where(np.einsum("ij,ij->i", normals, view) < 0.0, -1.0, 1.0)
    normals = normals * facing[:, None]
    towards = np.asarray(light.direction, dtype=np.float64)
    diffuse = np.maximum(normals @ towards, 0.0)
    halfway = np.maximum(np.einsum("ij,ij->i", normals, _unit(view + towards)), 0.0)
    highlight = np.where(diffuse > 0.0, halfway**light.shininess, 0.0)
    color = np.asarray(albedo, dtype=np.float64) * (
        light.ambient + light.diffuse * diffuse[:, None]
    )
    color += 255.0 * light.specular * highlight[:, None]
    return np.asarray(np.clip(np.rint(color), 0, 255), dtype=np.uint8)


def _unit(vectors: Points) -> Points:
    """Vectors scaled to unit length; a vector of length 0 stays 0."""
    vectors = np.asarray(vectors, dtype=np.float64)
    length = np.linalg.norm(vectors, axis=1, keepdims=True)
    return np.asarray(vectors / np.where(length > 0.0, length, 1.0))


NEAR = 0.01
"""Triangles with a corner nearer to the camera than this (m) are not drawn."""


@compiled()
def fill_triangles(
    corners: Points,
    faces: Int[np.ndarray, "f 3"],
    inverse_depth: Image,
    triangles: Int[np.ndarray, "h w"],
) -> None:
    """Draw triangles into a z-buffer of inverse depths (1/m, 0 = nothing), keeping the nearest.

    `corners` are (x px, y px, 1/z) of each vertex; a vertex with 1/z <= 0 drops its triangles.
    `triangles` receives the index of the face seen at each pixel. Edges belong to both triangles
    that share them, with a tolerance above the rounding error, so that they leave no gap.
    """
    for face in range(faces.shape[0]):
        _fill_triangle(corners, faces, face, inverse_depth, triangles)


@compiled(inline="always")
def _fill_triangle(
    corners: Points,
    faces: Int[np.ndarray, "f 3"],
    face: int,
    inverse_depth: Image,
    triangles: Int[np.ndarray, "h w"],
) -> None:
    """Draw one triangle, see fill_triangles."""
    height, width = inverse_depth.shape
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
        return
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
            triangles[y, x] = face if nearest else triangles[y, x]


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

    def draw(index: int) -> None:
        points = transform(poses_cam_obj[index], mesh.vertices)
        inverse_depth, _ = _draw(points, mesh.faces, camera_matrix, shape)
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
    meshes = [mesh for mesh, _ in parts]
    placed = list(zip(poses, meshes, strict=True))
    points = np.concatenate([transform(pose, mesh.vertices) for pose, mesh in placed])
    normals = np.concatenate([mesh.normals @ pose[:3, :3].T for pose, mesh in placed])
    colors = np.concatenate([mesh.colors for mesh in meshes])
    starts = np.cumsum([0] + [len(mesh.vertices) for mesh in meshes[:-1]])
    faces = np.concatenate([mesh.faces + start for mesh, start in zip(meshes, starts, strict=True)])
    last_face = np.cumsum([len(mesh.faces) for mesh in meshes])
    inverse_depth, triangles = _draw(points, faces, camera_matrix, shape)
    seen = triangles >= 0
    corners = faces[triangles[seen]]
    weights = _corner_weights(points[corners], np.argwhere(seen)[:, ::-1], camera_matrix)
    rgb = np.zeros((*shape, 3), dtype=np.uint8)
    rgb[seen] = shade(
        np.einsum("ni,nij->nj", weights, colors[corners]),
        np.einsum("ni,nij->nj", weights, normals[corners]),
        -np.einsum("ni,nij->nj", weights, points[corners]),
        light,
    )
    index = np.full(shape, -1, dtype=np.int64)
    index[seen] = np.searchsorted(last_face, triangles[seen], side="right")
    return rgb, _depth(inverse_depth), index


def _draw(
    points_cam: Points,
    faces: Int[np.ndarray, "f 3"],
    camera_matrix: CameraMatrix,
    shape: tuple[int, int],
) -> tuple[Image, Int[np.ndarray, "h w"]]:
    """Inverse depth (0 = nothing) and face index (-1 = nothing) of triangles in camera space."""
    z = points_cam[:, 2]
    inverse = np.where(z >= NEAR, 1.0 / np.where(z >= NEAR, z, 1.0), 0.0)
    corners = np.empty((len(points_cam), 3))
    corners[:, 0] = points_cam[:, 0] * inverse * camera_matrix[0, 0] + camera_matrix[0, 2]
    corners[:, 1] = points_cam[:, 1] * inverse * camera_matrix[1, 1] + camera_matrix[1, 2]
    corners[:, 2] = inverse
    inverse_depth = np.zeros(shape)
    triangles = np.full(shape, -1, dtype=np.int32)
    faces = np.ascontiguousarray(faces, dtype=np.int32)
    fill_triangles(corners, faces, inverse_depth, triangles)
    return inverse_depth, triangles


def _corner_weights(
    corners_cam: Float[np.ndarray, "n 3 3"], pixels: Pixels, camera_matrix: CameraMatrix
) -> Points:
    """Perspective-correct weights of each triangle's corners where a pixel's ray meets it."""
    rays = np.ones((len(pixels), 3))
    rays[:, :2] = (pixels - camera_matrix[:2, 2]) / camera_matrix[[0, 1], [0, 1]]
    a, b, c = corners_cam[:, 0], corners_cam[:, 1], corners_cam[:, 2]
    # The ray's three volumes with the edges, one for the corner opposite to each edge.
    volumes = np.stack([np.cross(b, c), np.cross(c, a), np.cross(a, b)], axis=1)
    weights = np.einsum("nij,nj->ni", volumes, rays)
    weights = np.maximum(weights * np.sign(weights.sum(axis=1, keepdims=True)), 0.0)
    return np.asarray(weights / weights.sum(axis=1, keepdims=True))


def _depth(inverse_depth: Image) -> Image:
    drawn = inverse_depth > 0.0
    depth = np.zeros(inverse_depth.shape, dtype=np.float32)
    depth[drawn] = 1.0 / inverse_depth[drawn]
    return depth


def _require_finite(poses_cam_obj: Poses) -> None:
    bad = ~np.isfinite(poses_cam_obj).all(axis=(-2, -1))
    if bad.any():
        raise ValueError(f"poses_cam_obj[{int(np.flatnonzero(bad)[0])}] is not finite (nan or inf)")
