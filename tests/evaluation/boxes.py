"""Boxes as object models, for the tests of this folder."""

from collections.abc import Sequence

import numpy as np
import trimesh

from hlp.records import ObjectModel
from refinement_scene import as_mesh


def box_model(
    extents: Sequence[float],
    object_id: int = 1,
    name: str = "box",
    symmetries: np.ndarray | None = None,
    center: Sequence[float] = (0.0, 0.0, 0.0),
    fine: bool = True,
) -> ObjectModel:
    """A box about a place in object coordinates (m), with or without vertices between corners."""
    box = trimesh.creation.box(extents)
    box = box.subdivide().subdivide() if fine else box
    box.apply_translation(center)
    mesh, diameter = as_mesh(box), float(np.linalg.norm(extents))
    motions = np.eye(4)[None] if symmetries is None else symmetries
    return ObjectModel(object_id, name, mesh, mesh, diameter, motions, 0.08, 0.03)
