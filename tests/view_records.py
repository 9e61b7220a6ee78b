"""Records of views and of patches that are made without rendering."""

import numpy as np
from scipy.spatial.transform import Rotation

from hlp.geometry import rigid
from hlp.records import LocalPatches, Views


def square_views() -> Views:
    """A grey square from four viewpoints a right angle apart about y, each in two turns."""
    poses = []
    for yaw in (0, 90, 180, 270):
        for roll in (0, 30):
            turn = Rotation.from_euler("yz", [yaw, roll], degrees=True)
            poses.append(rigid(turn.as_matrix(), np.array([0.0, 0.0, 0.5])))
    rgb = np.full((8, 16, 16, 3), 90, np.uint8)
    depth = np.zeros((8, 16, 16), np.float32)
    depth[:, 4:12, 4:12] = 0.5
    return Views(1, rgb, depth, np.stack(poses), np.array([[50.0, 0, 8], [0, 50.0, 8], [0, 0, 1]]))


def random_patches(count: int, seed: int = 0) -> LocalPatches:
    """Local patches of noise, a tenth of whose pixels has no depth."""
    rng = np.random.default_rng(seed)
    return LocalPatches(
        rng.integers(0, 256, (count, 32, 32, 3)).astype(np.uint8),
        rng.uniform(-1, 1, (count, 32, 32)).astype(np.float32),
        rng.random((count, 32, 32)) < 0.9,
        np.zeros((count, 3)),
        np.zeros((count, 2)),
    )
