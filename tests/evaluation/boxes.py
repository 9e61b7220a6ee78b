"""Boxes as object models and poses of them, for the tests of this folder."""

from dataclasses import replace

import numpy as np
import trimesh
from scipy.spatial.transform import Rotation

from hlp.geometry import rigid
from refinement_scene import model_of


def box_model(extents, object_id=1, name="box", symmetries=None, center=(0.0, 0.0, 0.0), fine=True):
    """A box about a place in object coordinates (m), with or without vertices between corners."""
    box = trimesh.creation.box(extents)
    box = box.subdivide().subdivide() if fine else box
    box.apply_translation(center)
    model = replace(model_of(box, name=name), object_id=object_id)
    return model if symmetries is None else replace(model, symmetries=symmetries)


EXTENTS = (0.06, 0.08, 0.10)
K = np.array([[570.0, 0.0, 81.3], [0.0, 560.0, 58.6], [0.0, 0.0, 1.0]])
TRUE = rigid(Rotation.from_euler("xyz", [0.4, 0.2, 0.1]).as_matrix(), np.array([0.01, 0.0, 0.8]))


def moved(dx=0.0, dy=0.0, dz=0.0, degrees=0.0):
    """The true pose, turned about the camera's y axis and shifted (m)."""
    pose = TRUE.copy()
    pose[:3, :3] = Rotation.from_euler("y", degrees, degrees=True).as_matrix() @ pose[:3, :3]
    pose[:3, 3] += [dx, dy, dz]
    return pose
