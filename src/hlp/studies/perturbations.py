"""Coarse poses with a given error."""

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from hlp.geometry import rigid


def perturbed_poses(
    pose_cam_obj: Float[np.ndarray, "4 4"],
    centroid: Float[np.ndarray, "3"],
    degrees: Float[np.ndarray, "n"],
    millimetres: Float[np.ndarray, "n"],
    rng: np.random.Generator,
) -> Float[np.ndarray, "n 4 4"]:
    """Poses rotated about the object's centroid by `degrees` and shifted by `millimetres`.

    Each has its own axis and direction, drawn uniformly on the sphere; the sizes are exact.
    `centroid` is in object coordinates (m).
    """
    axes, directions = _on_sphere(len(degrees), rng), _on_sphere(len(degrees), rng)
    turns = Rotation.from_rotvec(axes * np.deg2rad(degrees)[:, None]).as_matrix()
    rotations = turns @ pose_cam_obj[:3, :3]
    middle = pose_cam_obj[:3, :3] @ centroid + pose_cam_obj[:3, 3]
    shifted = middle + directions * np.asarray(millimetres)[:, None] / 1e3
    return rigid(rotations, shifted - rotations @ centroid)


def _on_sphere(count: int, rng: np.random.Generator) -> Float[np.ndarray, "n 3"]:
    drawn = rng.normal(size=(count, 3))
    return np.asarray(drawn / np.linalg.norm(drawn, axis=1, keepdims=True))
