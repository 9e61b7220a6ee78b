"""Fast triangle z-buffer for many small drawings of a mesh: single precision, vectorised.

Vertices are projected in double precision and drawn in single: eight pixels fit where four did, and
a depth is still exact to a thousandth of a millimetre. The loops are written so that the compiler
turns them into vector instructions. `rasterizer` is the reference.
"""

from functools import lru_cache

import numpy as np
from jaxtyping import Float, Float32, Int, Int32, Shaped
from numba import njit

from hlp.records import Mesh
from hlp.rendering.rasterizer import NEAR, is_closed

LANES = 4
"""Pixels of a row that are drawn at once."""
_ONE, _ZERO = np.float32(1.0), np.float32(0.0)
_FAR = np.float32(np.inf)
# Edges belong to both triangles that share them, with a tolerance of so many pixels: above single
# precision's rounding error in a region of some hundred pixels, so that no crack is left between.
_TOLERANCE = np.float32(1e-5)


@lru_cache(maxsize=32)
def prepared(mesh: Mesh) -> tuple[Float[np.ndarray, "3 v"], Int32[np.ndarray, "f 3"], bool]:
    """Vertices by coordinate, faces, and whether back faces are hidden: once for each mesh."""
    faces = np.ascontiguousarray(mesh.faces, dtype=np.int32)
    closed = is_closed(faces, mesh.vertices)
    return np.ascontiguousarray(mesh.vertices.T, dtype=np.float64), faces, closed


@njit(nogil=True, cache=True)
def framed(height: int, width: int) -> Float32[np.ndarray, "h+2 w+5"]:
    """A buffer of inverse depths (1/m): nothing, within a frame of infinitely near pixels.

    So nothing is drawn on the frame, and no edge is ever seen against it. To the right there is
    room for the lanes that a triangle does not fill.
    """
    inverse = np.full((height + 2, width + 1 + LANES), _FAR, dtype=np.float32)
    inverse[1 : height + 1, 1 : width + 1] = _ZERO
    return inverse


def in_frame(image: Shaped[np.ndarray, "h w"]) -> Float32[np.ndarray, "h+2 w+5"]:
    """An image laid out as a framed buffer, 0 on the frame: both can be read row behind row."""
    height, width = image.shape
    laid_out = np.zeros((height + 2, width + 1 + LANES), dtype=np.float32)
    laid_out[1 : height + 1, 1 : width + 1] = image
    return laid_out


@njit(nogil=True, cache=True)
def project_vertices(
    pose: Float[np.ndarray, "4 4"],
    vertices: Float[np.ndarray, "3 v"],
    camera: Float[np.ndarray, "3 3"],
    corners: Float[np.ndarray, "3 v"],
) -> None:
    """(x px, y px, 1/z) of each vertex; 1/z = 0 where it is nearer than NEAR."""
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


@njit(nogil=True, cache=True)
def draw_triangles(
    corners: Float32[np.ndarray, "3 v"],
    faces: Int[np.ndarray, "f 3"],
    cull: bool,
    inverse: Float32[np.ndarray, "h+2 w+5"],
    triangles: Int32[np.ndarray, "h+2 w+5"] | None,
) -> None:
    """As `rasterizer.fill_triangles`, in single precision, into a buffer made by `framed`.

    `corners` are (x px, y px, 1/z) of each vertex, x and y counted from within the frame. `cull`
    skips back faces (right for closed meshes, see `rasterizer.is_closed`). `triangles` receives the
    index of the face seen at each pixel, if asked for.
    """
    height, stride = inverse.shape[0] - 2, inverse.shape[1]
    width = stride - 1 - LANES
    flat = inverse.reshape(-1)
    if triangles is not None:  # decided when the kernel is compiled
        seen = triangles.reshape(-1)
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
        x0 = max(int(np.ceil(left - _TOLERANCE)), 0)
        x1 = min(int(np.floor(right + _TOLERANCE)), width - 1)
        y0 = max(int(np.ceil(top - _TOLERANCE)), 0)
        y1 = min(int(np.floor(bottom + _TOLERANCE)), height - 1)
        low, high = min(wa, wb, wc), max(wa, wb, wc)
        if x0 > x1 or y0 > y1 or area == _ZERO or low <= _ZERO:
            continue
        # Weights of corners b and c grow linearly from corner a; corner a has the rest.
        scale = _ONE / area
        b_x, b_y = (cy - ay) * scale, (ax - cx) * scale
        c_x, c_y = (ay - by) * scale, (bx - ax) * scale
        w_x, w_y = b_x * (wb - wa) + c_x * (wc - wa), b_y * (wb - wa) + c_y * (wc - wa)
        least_weight = -_TOLERANCE * (right - left + bottom - top) * abs(scale)
        dx = np.float32(x0) - ax
        # Whole lanes, as unsigned numbers: what the compiler needs for vectors without remainder.
        lanes = np.uintp((x1 - x0 + LANES) // LANES * LANES)
        start = np.uintp((y0 + 1) * stride + x0 + 1)
        for y in range(y0, y1 + 1):
            dy = np.float32(y) - ay
            b_0, c_0, w_0 = b_x * dx + b_y * dy, c_x * dx + c_y * dy, wa + w_x * dx + w_y * dy
            for k in range(lanes):
                along = np.float32(np.int32(k))
                weight_b, weight_c = b_0 + along * b_x, c_0 + along * c_x
                least = min(min(weight_b, weight_c), _ONE - weight_b - weight_c)
                # A pixel within the tolerance may lie outside a sliver: do not extrapolate there.
                w = min(max(w_0 + along * w_x, low), high)
                before = flat[start + k]
                nearest = (least >= least_weight) & (w > before)
                flat[start + k] = w if nearest else before
                if triangles is not None:
                    seen[start + k] = np.int32(face) if nearest else seen[start + k]
            start += np.uintp(stride)
