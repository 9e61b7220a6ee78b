"""Rigid motions, projection, back-projection and distances between rotations. Metres, radians."""

import numpy as np
from jaxtyping import Float

from hlp.arrays import CameraMatrix, Rotation

Array = Float[np.ndarray, "..."]


def rigid(rotation: Float[np.ndarray, "*#b 3 3"], translation: Float[np.ndarray, "*#b 3"]) -> Array:
    """Rigid motions (…, 4, 4) of rotations (…, 3, 3) and translations (…, 3)."""
    rotation, translation = np.asarray(rotation), np.asarray(translation)
    shape = np.broadcast_shapes(rotation.shape[:-2], translation.shape[:-1])
    motion = np.zeros((*shape, 4, 4))
    motion[..., :3, :3] = rotation
    motion[..., :3, 3] = translation
    motion[..., 3, 3] = 1.0
    return motion


def inverse(motion: Float[np.ndarray, "*b 4 4"]) -> Array:
    """Inverse of rigid motions (…, 4, 4)."""
    rotation = np.swapaxes(motion[..., :3, :3], -1, -2)
    return rigid(rotation, -np.einsum("...ij,...j->...i", rotation, motion[..., :3, 3]))


def transform(
    motion: Float[np.ndarray, "*#b 4 4"], points: Float[np.ndarray, "*#b n 3"]
) -> Float[np.ndarray, "*b n 3"]:
    """Apply motions (…, 4, 4) to points (…, n, 3)."""
    rotated = points @ np.swapaxes(motion[..., :3, :3], -1, -2)
    return np.asarray(rotated + motion[..., None, :3, 3])


def project(
    points_cam: Float[np.ndarray, "*b 3"], camera_matrix: CameraMatrix
) -> Float[np.ndarray, "*b 2"]:
    """Pixels (x, y) of points in front of the camera (z > 0); pixel centres are integers."""
    focal = camera_matrix[[0, 1], [0, 1]]
    return np.asarray(points_cam[..., :2] / points_cam[..., 2:] * focal + camera_matrix[:2, 2])


def back_project(
    pixels: Float[np.ndarray, "*b 2"], depth: Float[np.ndarray, "*b"], camera_matrix: CameraMatrix
) -> Float[np.ndarray, "*b 3"]:
    """Points in camera coordinates (m) of pixels (x, y) at a depth along z (m)."""
    focal = camera_matrix[[0, 1], [0, 1]]
    plane = (np.asarray(pixels) - camera_matrix[:2, 2]) / focal
    return np.concatenate([plane * depth[..., None], depth[..., None]], axis=-1)


def rotation_distance(
    first: Float[np.ndarray, "*#b 3 3"], second: Float[np.ndarray, "*#b 3 3"]
) -> Float[np.ndarray, "*b"]:
    """Angle (rad) of the rotation that takes one rotation to the other.

    Computed from ‖A − B‖ = 2√2 sin(θ/2): the trace's arc cosine would lose half the digits near 0.
    """
    chord = np.linalg.norm(np.asarray(first) - np.asarray(second), axis=(-2, -1))
    return np.asarray(2.0 * np.arcsin(np.clip(chord / (2.0 * np.sqrt(2.0)), 0.0, 1.0)))


def allocentric_to_egocentric(rays: Float[np.ndarray, "*b 3"]) -> Float[np.ndarray, "*b 3 3"]:
    """Smallest rotation (…, 3, 3) from the optical axis to each ray (…, 3) of any length.

    Views are rendered at the image centre. An object seen along another ray looks like the view
    with rotation R (allocentric) if its rotation in the camera's frame (egocentric) is
    `allocentric_to_egocentric(ray) @ R`.
    """
    unit = rays / np.linalg.norm(rays, axis=-1, keepdims=True)
    x, y, z = unit[..., 0], unit[..., 1], unit[..., 2]
    shared = 1.0 / (1.0 + z)
    rows = [
        [1.0 - x * x * shared, -x * y * shared, x],
        [-x * y * shared, 1.0 - y * y * shared, y],
        [-x, -y, z],
    ]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def quaternions(rotations: Float[np.ndarray, "*b 3 3"]) -> Float[np.ndarray, "*b 4"]:
    """Unit quaternions (x, y, z, w) of rotations, which are not checked; q and −q are one rotation.

    The largest of the four components is computed first, as in Shepperd, "Quaternion from rotation
    matrix", J. Guidance and Control 1978.
    """
    # SciPy's Rotation gives the same bits, but importing it takes longer than finding an object.
    matrices = np.reshape(np.asarray(rotations, dtype=np.float64), (-1, 3, 3))
    diagonal = matrices[:, [0, 1, 2], [0, 1, 2]]
    trace = diagonal[:, 0] + diagonal[:, 1] + diagonal[:, 2]
    largest = np.argmax(np.column_stack([diagonal, trace]), axis=1)
    quats = np.empty((len(matrices), 4))
    for i in range(3):
        j, k, chosen = (i + 1) % 3, (i + 2) % 3, largest == i
        m = matrices[chosen]
        quats[chosen, i] = 1.0 - trace[chosen] + 2.0 * m[:, i, i]
        quats[chosen, j] = m[:, j, i] + m[:, i, j]
        quats[chosen, k] = m[:, k, i] + m[:, i, k]
        quats[chosen, 3] = m[:, k, j] - m[:, j, k]
    chosen = largest == 3
    m = matrices[chosen]
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        quats[chosen, i] = m[:, k, j] - m[:, j, k]
    quats[chosen, 3] = 1.0 + trace[chosen]
    return np.reshape(quats / _lengths(quats), (*np.shape(rotations)[:-2], 4))


def rotation_matrices(quats: Float[np.ndarray, "*b 4"]) -> Float[np.ndarray, "*b 3 3"]:
    """Rotations of quaternions (x, y, z, w) of any length. Raises ValueError for length 0."""
    flat = np.reshape(np.asarray(quats, dtype=np.float64), (-1, 4))
    lengths = _lengths(flat)
    if (lengths == 0.0).any():
        raise ValueError("a quaternion of zero norm is not a rotation")
    x, y, z, w = (flat / lengths).T
    xx, yy, zz, ww = x * x, y * y, z * z, w * w
    xy, zw, xz, yw, yz, xw = x * y, z * w, x * z, y * w, y * z, x * w
    values = [
        *(xx - yy - zz + ww, 2.0 * (xy - zw), 2.0 * (xz + yw)),
        *(2.0 * (xy + zw), -xx + yy - zz + ww, 2.0 * (yz - xw)),
        *(2.0 * (xz - yw), 2.0 * (yz + xw), -xx - yy + zz + ww),
    ]
    return np.reshape(np.stack(values, axis=-1), (*np.shape(quats)[:-1], 3, 3))


def _lengths(quats: Float[np.ndarray, "n 4"]) -> Float[np.ndarray, "n 1"]:
    x, y, z, w = quats.T
    return np.asarray(np.sqrt(x * x + y * y + z * z + w * w)[:, None])


def nearest_rotation(matrix: Rotation) -> Rotation:
    """The rotation closest to a matrix in the Frobenius norm, as files store rounded rotations."""
    u, _, vt = np.linalg.svd(matrix)
    return np.asarray(u @ np.diag([1.0, 1.0, np.linalg.det(u @ vt)]) @ vt)


def nearest_symmetric_pose(other: Array, pose: Array, symmetries: Array) -> Array:
    """Of the poses that symmetries (n, 4, 4) make of one, the least turned against `other`."""
    alike = pose @ symmetries
    return np.asarray(alike[np.argmin(rotation_distance(other[:3, :3], alike[:, :3, :3]))])
