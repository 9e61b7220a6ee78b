"""The decimated mesh that poses are drawn with: as few triangles as show the same object."""

import logging

import numpy as np
from jaxtyping import Bool, Float

from hlp.geometry import rigid
from hlp.objects.meshes import decimate
from hlp.records import Mesh
from hlp.rendering.rasterizer import render_depth
from hlp.rendering.viewpoints import thomson, view_rotations

_VIEWS = 12
_SIDE, _OBJECT = 112, 96  # px, of the image and of the diameter in it
_FOCAL = 1000.0  # px: the object is far away, so that no side of it is hidden
_OVERLAP = 0.85  # of both meshes' pixels; of 500 triangles of a scan it is .88 or more
_NEAR = 0.01  # of the diameter: pixels whose depths differ by more do not count as the same
_logger = logging.getLogger(__name__)


def build_proxy(mesh: Mesh, faces: int, diameter: float) -> Mesh:
    """The mesh decimated to `faces` triangles, or twice as many as often as it takes to look alike.

    Scanned surfaces keep their shape; of a CAD model, whose large faces are few triangles already,
    whole walls may vanish: a proxy that lacks them fits no image of the object. `diameter` is in m.
    Raises ValueError for fewer than 4 faces.
    """
    poses, camera = _poses(mesh, diameter)
    full = render_depth(mesh, poses, camera, (_SIDE, _SIDE))
    wanted = faces
    while True:
        proxy = decimate(mesh, wanted)
        if proxy is mesh:
            return mesh
        drawn = render_depth(proxy, poses, camera, (_SIDE, _SIDE))
        either = (full > 0.0) | (drawn > 0.0)
        if np.count_nonzero(_alike(full, drawn, diameter)) >= _OVERLAP * np.count_nonzero(either):
            break
        wanted *= 2
    if wanted > faces:
        _logger.info(
            "poses are drawn with %d triangles: %d lose its shape", len(proxy.faces), faces
        )
    return proxy


def _poses(
    mesh: Mesh, diameter: float
) -> tuple[Float[np.ndarray, "n 4 4"], Float[np.ndarray, "3 3"]]:
    """Poses from all sides, and the camera's matrix."""
    rotations = view_rotations(thomson(_VIEWS, 0), np.zeros(1))
    middle = (mesh.vertices.min(axis=0) + mesh.vertices.max(axis=0)) / 2.0
    ahead = np.array([0.0, 0.0, _FOCAL * diameter / _OBJECT])
    centre = (_SIDE - 1) / 2.0
    camera = np.array([[_FOCAL, 0.0, centre], [0.0, _FOCAL, centre], [0.0, 0.0, 1.0]])
    return rigid(rotations, ahead - rotations @ middle), camera


def _alike(
    first: Float[np.ndarray, "n h w"], second: Float[np.ndarray, "n h w"], diameter: float
) -> Bool[np.ndarray, "n h w"]:
    """Pixels where both meshes are drawn, at nearly the same depth."""
    both = (first > 0.0) & (second > 0.0)
    return np.asarray(both & (np.abs(first - second) <= _NEAR * diameter))
