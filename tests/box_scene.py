"""A box in front of a wall, for tests of pictures."""

import numpy as np
import trimesh

from hlp.records import Frame, ObjectModel
from hlp.rendering.rasterizer import render_depth
from refinement_scene import as_mesh

SHAPE = (240, 320)
CAMERA = np.array([[300.0, 0.0, 159.5], [0.0, 300.0, 119.5], [0.0, 0.0, 1.0]])


def at(x: float, y: float, z: float) -> np.ndarray:
    pose = np.eye(4)
    pose[:3, 3] = x, y, z
    return pose


def box_model() -> ObjectModel:
    shape = trimesh.creation.box((0.1, 0.14, 0.2))
    mesh = as_mesh(shape, (200, 200, 200))
    return ObjectModel(1, "box", mesh, mesh, float(np.hypot(0.1, 0.14)), np.eye(4)[None], 0.2, 0.1)


def box_frame(box: ObjectModel) -> Frame:
    """The box at (0.05, 0, 0.8), grey in front of a darker wall at 1.2 m."""
    depth = render_depth(box.mesh, at(0.05, 0.0, 0.8)[None], CAMERA, SHAPE)[0]
    rgb = np.where(depth[..., None] > 0, 180, 100) * np.ones(3)
    seen = np.where(depth > 0, depth, 1.2).astype(np.float32)
    return Frame(1, 2, rgb.astype(np.uint8), seen, CAMERA)
