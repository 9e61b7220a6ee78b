"""Triangle z-buffer on the CPU (numba) without OpenGL: depth of many poses, or RGB-D of a scene.

Pixel centres have integer coordinates. 1/z is interpolated linearly in the image, which is exact
for planes. Both sides of a triangle are visible, because scanned meshes are not wound consistently.
Kernels are serial and release the GIL; threads render different poses. `shading` gives the colours.
"""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float, Int, Int32

from hlp.arrays import CameraMatrix, Image, Points, Pose, Poses, Rgb
from hlp.geometry import transform
from hlp.kernels import compiled, compiled_ahead
from hlp.records import Mesh
from hlp.rendering.shading import Light, Surface, shade_surface
from hlp.threads import ThreadTeam

NEAR = 0.01
"""Triangles with a corner nearer to the camera than this (m) are not drawn."""
_TOLERANCE = 1e-6  # px, above the rounding error


@compiled_ahead()
def fill_triangles(
    corners: Points,
    faces: Int32[np.ndarray, "f 3"],
    inverse_depth: Image,
    triangles: Int32[np.ndarray, "h w"],
    first: int,
) -> None:
    """Draw triangles into a z-buffer of inverse depths (1/m, 0 = nothing), keeping the nearest.

    `corners` are (x px, y px, 1/z) of each vertex; a vertex with 1/z <= 0 drops its triangles.
    `triangles` receives the index of the face seen at each pixel, plus `first`. Edges belong to
    both their triangles, with a tolerance above the rounding error, and leave no gap.
    """
    for face in range(faces.shape[0]):
        a, b, c = faces[face, 0], faces[face, 1], faces[face, 2]
        ax, ay, wa = corners[a, 0], corners[a, 1], corners[a, 2]
        bx, by, wb = corners[b, 0], corners[b, 1], corners[b, 2]
        cx, cy, wc = corners[c, 0], corners[c, 1], corners[c, 2]
        area = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)
        x0, x1 = covered(min(ax, bx, cx), max(ax, bx, cx), _TOLERANCE, inverse_depth.shape[1])
        y0, y1 = covered(min(ay, by, cy), max(ay, by, cy), _TOLERANCE, inverse_depth.shape[0])
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
                # And no branch: mispredicted ones take 2.6 times as long as this arithmetic.
                w = min(max(wa + weight_b * (wb - wa) + weight_c * (wc - wa), low), high)
                nearest = (least >= tolerance) & (w > inverse_depth[y, x])
                inverse_depth[y, x] = w if nearest else inverse_depth[y, x]
                triangles[y, x] = first + face if nearest else triangles[y, x]


@compiled(inline="always")
def covered(low: float, high: float, tolerance: float | np.float32, size: int) -> tuple[int, int]:
    """First and last of `size` pixels between two positions (px)."""
    return max(int(np.ceil(low - tolerance)), 0), min(int(np.floor(high + tolerance)), size - 1)


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

    faces = np.ascontiguousarray(mesh.faces, np.int32)

    def draw(index: int) -> None:
        corners = project_corners(transform(poses_cam_obj[index], mesh.vertices), camera_matrix)
        rows, columns = spanned_box(corners, shape)
        corners[:, :2] -= columns.start, rows.start  # whole pixels: without rounding
        part = _empty((rows.stop - rows.start, columns.stop - columns.start))
        fill_triangles(corners, faces, *part, 0)
        depth[index, rows, columns] = _depth(part[0])

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
        surface = Surface(
            first,
            np.ascontiguousarray(mesh.faces, dtype=np.int32),
            transform(pose, mesh.vertices),
            np.ascontiguousarray(mesh.normals, dtype=np.float64),
            np.ascontiguousarray(mesh.colors),
            np.ascontiguousarray(pose[:3, :3]),
        )
        corners = project_corners(surface.points_cam, camera_matrix)
        fill_triangles(corners, surface.faces, inverse_depth, triangles, first)
        drawn.append(surface)
        first += len(surface.faces)
    rgb = np.zeros((*shape, 3), dtype=np.uint8)
    index = np.full(shape, -1, dtype=np.int64)
    camera = np.asarray(camera_matrix, dtype=np.float64)
    for part, surface in enumerate(drawn):
        shade_surface(surface, triangles, camera, light, part, rgb, index)
    return rgb, _depth(inverse_depth), index


def _empty(shape: tuple[int, int]) -> tuple[Image, Int32[np.ndarray, "h w"]]:
    """Inverse depth (0 = nothing) and face index (-1 = nothing)."""
    return np.zeros(shape), np.full(shape, -1, dtype=np.int32)


def project_corners(points_cam: Points, camera_matrix: CameraMatrix) -> Points:
    """Vertices as `fill_triangles` takes them."""
    z = points_cam[:, 2]
    inverse = np.where(z >= NEAR, 1.0 / np.where(z >= NEAR, z, 1.0), 0.0)
    x, y = (points_cam[:, i] * inverse * camera_matrix[i, i] + camera_matrix[i, 2] for i in (0, 1))
    return np.stack([x, y, inverse], axis=-1)


def spanned_box(corners: Points, shape: tuple[int, int], border: int = 0) -> tuple[slice, slice]:
    """Rows and columns of an image that corners in front of the camera span, and a border (px)."""
    drawn = corners[corners[:, 2] > 0.0, 1::-1]
    drawn = drawn if len(drawn) else np.zeros((1, 2))  # one pixel for nothing
    first = np.clip(np.floor(drawn.min(axis=0)), 0, shape).astype(int)
    last = np.clip(np.ceil(drawn.max(axis=0)) + 1, first, shape).astype(int)
    first, last = np.maximum(first - border, 0), np.minimum(last + border, shape)
    return slice(int(first[0]), int(last[0])), slice(int(first[1]), int(last[1]))


def _depth(inverse_depth: Image) -> Image:
    drawn = inverse_depth > 0.0
    depth = np.zeros(inverse_depth.shape, dtype=np.float32)
    depth[drawn] = 1.0 / inverse_depth[drawn]
    return depth


def _require_finite(poses_cam_obj: Poses) -> None:
    bad = ~np.isfinite(poses_cam_obj).all(axis=(-2, -1))
    if bad.any():
        raise ValueError(f"poses_cam_obj[{int(np.flatnonzero(bad)[0])}] is not finite (nan or inf)")
