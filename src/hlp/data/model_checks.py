"""Whether what a data set states of an object is true of its mesh."""

import numpy as np

from hlp.errors import DataError
from hlp.geometry import transform
from hlp.objects.meshes import mesh_diameter
from hlp.records import MILLIMETRES_PER_METRE, ObjectModel
from hlp.rendering.surface_samples import sample_surface

DIAMETER_TOLERANCE = 1.25
"""A stated diameter may be that many times larger or smaller than the mesh's."""
SYMMETRY_TOLERANCE = 0.05
"""A stated symmetry may take the surface from itself by this share of the diameter, on average."""
_SAMPLES, _MOVED = 5_000, 500
_MOST_CHECKED = 24  # motions, spread over all that are stated


def check_diameter(model: ObjectModel, where: str) -> None:
    """Raise DataError if the stated diameter is not that of the mesh, as in another unit."""
    measured = mesh_diameter(model.mesh.vertices)
    ratio = model.diameter / measured
    if not 1 / DIAMETER_TOLERANCE <= ratio <= DIAMETER_TOLERANCE:
        raise DataError(
            f"{where}: diameter is {model.diameter * MILLIMETRES_PER_METRE:.6g}, the mesh's is "
            f"{measured * MILLIMETRES_PER_METRE:.6g}: it must be in millimetres, and of this mesh"
        )


def check_symmetries(model: ObjectModel, where: str) -> None:
    """Raise DataError if a stated symmetry does not map the mesh onto itself."""
    from scipy.spatial import cKDTree

    if len(model.symmetries) == 1:
        return
    points = sample_surface(model.mesh, _SAMPLES).points
    tree, moving = cKDTree(points), points[:: _SAMPLES // _MOVED]
    limit = SYMMETRY_TOLERANCE * model.diameter
    step = max(1, len(model.symmetries) // _MOST_CHECKED)
    for motion in model.symmetries[1::step]:
        apart = float(tree.query(transform(motion, moving))[0].mean())
        if apart > limit:
            millimetres = apart * MILLIMETRES_PER_METRE
            turn = np.degrees(np.arccos(np.clip((np.trace(motion[:3, :3]) - 1) / 2, -1, 1)))
            raise DataError(
                f"{where}: a stated symmetry (a turn by {turn:.0f}°) takes the surface "
                f"{millimetres:.3g} mm from itself on average, at most "
                f"{limit * MILLIMETRES_PER_METRE:.3g} mm are possible: check its axis and offset"
            )
