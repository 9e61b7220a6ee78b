"""Fast triangle z-buffer for many small renderings of a mesh, in single precision, and its edges.

Vertices are projected in double precision and drawn in single precision, which doubles the number
of pixels per vector instruction and is exact to about a micrometre. The loops are written so that
the compiler can turn them into vector instructions. `rasterizer` is the reference.
"""

from functools import lru_cache
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Float32, Int, Int32, Shaped

from hlp.arrays import CameraMatrix, Points, Pose
from hlp.kernels import compiled
from hlp.records import Mesh
from hlp.rendering.rasterizer import NEAR, covered

VECTOR_WIDTH = 8
"""Pixels of a row that are drawn at once (SIMD lanes of AVX2): hardly a triangle is wider."""
DIRECTIONS = 4
"""Directions of an edge's gradient, of half a turn, from that of x towards y."""
_ONE, _ZERO, _TWO = np.float32(1.0), np.float32(0.0), np.float32(2.0)
_INFINITE, _EIGHTH = np.float32(np.inf), np.float32(np.tan(np.pi / 8.0))
# Pixels by which each triangle is extended, so that neighbours leave no gap: more than the rounding
# error of single precision in an image of a few hundred pixels.
_TOLERANCE = np.float32(1e-5)
_Three = tuple[np.float32, np.float32, np.float32]
_Row = Float32[np.ndarray, "w+9"]
ThreeRows = tuple[_Row, _Row, _Row]
"""A row of a framed buffer between the one above and the one below."""


class KernelMesh(NamedTuple):
    """A mesh as kernels read it: vertices (m) by coordinate, faces, and whether it is closed."""

    vertices: Float[np.ndarray, "3 v"]
    faces: Int32[np.ndarray, "f 3"]
    closed: bool


@lru_cache(maxsize=32)
def prepare_mesh(mesh: Mesh) -> KernelMesh:
    """The mesh for kernels, cached. Equal vertices become one; STL files repeat them for faces."""
    vertices, index = np.unique(mesh.vertices.astype(np.float64), axis=0, return_inverse=True)
    faces = index.reshape(-1)[mesh.faces].astype(np.int32)
    return KernelMesh(np.ascontiguousarray(vertices.T), faces, is_closed(faces, vertices))


def is_closed(faces: Int[np.ndarray, "f 3"], vertices: Points) -> bool:
    """Whether a mesh has no hole (edges go as often forth as back) and is wound outwards."""
    # Its back faces are not visible then, but where it folds over itself.
    start = np.asarray(faces, dtype=np.int64).ravel()
    end = np.roll(faces, -1, axis=1).astype(np.int64).ravel()
    forth = np.sort(start * len(vertices) + end)
    back = np.sort(end * len(vertices) + start)
    a, b, c = (vertices[faces[:, i]] for i in range(3))
    return bool(np.array_equal(forth, back) and np.einsum("ij,ij->", a, np.cross(b, c)) > 0.0)


@compiled()
def framed_buffer(height: int, width: int) -> Float32[np.ndarray, "h+2 w+9"]:
    """An empty buffer of inverse depths (1/m) inside a frame of infinitely near pixels.

    Nothing can be drawn on the frame, and no pixel has a depth edge towards it. On the right the
    frame is wide enough for whole vectors of pixels, which may exceed a triangle.
    """
    inverse = np.full((height + 2, width + 1 + VECTOR_WIDTH), _INFINITE, dtype=np.float32)
    inverse[1 : height + 1, 1 : width + 1] = _ZERO
    return inverse


def add_frame(image: Shaped[np.ndarray, "h w"]) -> Float32[np.ndarray, "h+2 w+9"]:
    """An image with the frame of `framed_buffer`, filled with 0, so that their pixels align."""
    height, width = image.shape
    padded = np.zeros((height + 2, width + 1 + VECTOR_WIDTH), dtype=np.float32)
    padded[1 : height + 1, 1 : width + 1] = image
    return padded


@compiled()
def project_vertices(
    pose: Pose,
    vertices: Float[np.ndarray, "3 v"],
    camera: CameraMatrix,
    corners: Float[np.ndarray, "3 v"],
) -> None:
    """Fill `corners` with (x px, y px, 1/z) of each vertex; 1/z = 0 if z < NEAR."""
    fx, fy, cx, cy = camera[0, 0], camera[1, 1], camera[0, 2], camera[1, 2]
    r00, r01, r02, t0 = pose[0, 0], pose[0, 1], pose[0, 2], pose[0, 3]
    r10, r11, r12, t1 = pose[1, 0], pose[1, 1], pose[1, 2], pose[1, 3]
    r20, r21, r22, t2 = pose[2, 0], pose[2, 1], pose[2, 2], pose[2, 3]
    for v in range(vertices.shape[1]):
        a, b, c = vertices[0, v], vertices[1, v], vertices[2, v]
        z = r20 * a + r21 * b + r22 * c + t2
        inverse = 1.0 / z if z >= NEAR else 0.0
        corners[0, v] = (r00 * a + r01 * b + r02 * c + t0) * inverse * fx + cx
        corners[1, v] = (r10 * a + r11 * b + r12 * c + t1) * inverse * fy + cy
        corners[2, v] = inverse


@compiled()
def draw_triangles(
    corners: Float32[np.ndarray, "3 v"],
    mesh: KernelMesh,
    inverse: Float32[np.ndarray, "h+2 w+9"],
    triangles: Int32[np.ndarray, "h+2 w+9"] | None,
) -> None:
    """Like `rasterizer.fill_triangles`, in single precision, into a `framed_buffer`.

    `corners` are (x px, y px, 1/z) of each vertex; pixel (0, 0) is the first inside the frame. Back
    faces of a closed mesh are skipped. `triangles`, unless it is None, receives the index of the
    face seen at each pixel.
    """
    height, stride = inverse.shape[0] - 2, inverse.shape[1]
    width = stride - 1 - VECTOR_WIDTH
    flat = inverse.reshape(-1)
    seen = None if triangles is None else triangles.reshape(-1)  # resolved at compile time
    faces, cull = mesh.faces, mesh.closed
    for face in range(faces.shape[0]):
        a, b, c = faces[face, 0], faces[face, 1], faces[face, 2]
        ax, ay, wa = corners[0, a], corners[1, a], corners[2, a]
        bx, by, wb = corners[0, b], corners[1, b], corners[2, b]
        cx, cy, wc = corners[0, c], corners[1, c], corners[2, c]
        area = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)
        if cull and area >= _ZERO:
            continue
        left, right = min(ax, bx, cx), max(ax, bx, cx)
        top, bottom = min(ay, by, cy), max(ay, by, cy)
        box = *covered(left, right, _TOLERANCE, width), *covered(top, bottom, _TOLERANCE, height)
        low, high = min(wa, wb, wc), max(wa, wb, wc)
        if box[0] > box[1] or box[2] > box[3] or area == _ZERO or low <= _ZERO:
            continue
        # Weights of corners b and c grow linearly from corner a; corner a has the rest.
        scale = _ONE / area
        b_x, b_y = (cy - ay) * scale, (ax - cx) * scale
        c_x, c_y = (ay - by) * scale, (bx - ax) * scale
        w_x, w_y = b_x * (wb - wa) + c_x * (wc - wa), b_y * (wb - wa) + c_y * (wc - wa)
        limits = -_TOLERANCE * (right - left + bottom - top) * abs(scale), low, high
        steps = (b_x, c_x, w_x), (b_y, c_y, w_y)
        _draw_box(flat, seen, stride, face, box, (ax, ay, wa), steps, limits)


@compiled(forceinline=True)
def _draw_box(
    flat: Float32[np.ndarray, "p"],
    seen: Int32[np.ndarray, "p"] | None,
    stride: int,
    face: int,
    box: tuple[int, int, int, int],
    corner: _Three,
    steps: tuple[_Three, _Three],
    limits: _Three,
) -> None:
    """Draw a triangle in a box, given by its first and last column and row.

    Two weights and the inverse depth change by `steps` per pixel along x and y, from 0, 0 and that
    of a corner; `limits` are those of the weights and of the inverse depth.
    """
    (x0, x1, y0, y1), (ax, ay, wa) = box, corner
    (b_x, c_x, w_x), (b_y, c_y, w_y) = steps
    least_weight, low, high = limits
    dx = np.float32(x0) - ax
    # Whole vectors of pixels, counted with unsigned integers, need no loop for the remainder.
    columns = np.uintp((x1 - x0 + VECTOR_WIDTH) // VECTOR_WIDTH * VECTOR_WIDTH)
    start = np.uintp((y0 + 1) * stride + x0 + 1)
    for y in range(y0, y1 + 1):
        dy = np.float32(y) - ay
        b_0, c_0, w_0 = b_x * dx + b_y * dy, c_x * dx + c_y * dy, wa + w_x * dx + w_y * dy
        for k in range(columns):
            along = np.float32(np.int32(k))
            weight_b, weight_c = b_0 + along * b_x, c_0 + along * c_x
            least = min(min(weight_b, weight_c), _ONE - weight_b - weight_c)
            # A pixel within the tolerance may lie outside a sliver: do not extrapolate there.
            w = min(max(w_0 + along * w_x, low), high)
            before = flat[start + k]
            nearest = (least >= least_weight) & (w > before)
            flat[start + k] = w if nearest else before
            if seen is not None:
                seen[start + k] = np.int32(face) if nearest else seen[start + k]
        start += np.uintp(stride)


@compiled(inline="always")
def edge_direction(around: ThreeRows, i: int) -> int:
    """Which of `DIRECTIONS` the gradient of inverse depth has, which is 0 beside a mesh.

    It is that of the middle row's pixel i + 1; the eight around it are taken.
    """
    above, here, below = around
    rising, falling = below[i + 2] - above[i], above[i + 2] - below[i]
    x = _TWO * (here[i + 2] - here[i]) + rising + falling
    y = _TWO * (below[i + 1] - above[i + 1]) + rising - falling
    turned = x * y
    x, y = abs(x), abs(y)
    if y < _EIGHTH * x:
        return 0
    if x < _EIGHTH * y:
        return 2
    return 1 if turned > _ZERO else 3
