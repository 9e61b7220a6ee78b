"""Object models of CAD files, named and numbered, as learning takes them; which will be hard."""

import logging
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Literal

import cv2
import numpy as np

from hlp.errors import InputError
from hlp.geometry import rigid
from hlp.method.learn.learnt_folder import NAME
from hlp.objects.object_model import ObjectSettings, build_object_model
from hlp.records import MILLIMETRE, MILLIMETRES_PER_METRE, ObjectModel
from hlp.rendering.rasterizer import render_depth
from hlp.rendering.sensor import depth_error
from hlp.rendering.surface import sample_surface
from hlp.rendering.views import thomson, view_rotations
from hlp.settings import Doc, Positive, PositiveOrNone, Settings

_PROXY_FACES = 500  # triangles of the mesh that the refiner renders
_FOCAL = 572.0  # px, of the depth cameras that most people have
_VIEWS = 16
_LEAST_THICKNESS = 10.0  # standard deviations of depth: thinner parts look like a plane
_LEAST_PX = 40.0  # px, along the diameter: below, recall falls to a half (docs/limits.md)
_WIDE = 7  # px: depth of what is narrower is mostly lost at its edges
_POINTS, _ROUND = 4000, 0.9  # on the surface; ratio of small to large radii of what is like a ball
_logger = logging.getLogger(__name__)


@dataclass(frozen=True, kw_only=True)
class MeshChoices(Settings):
    """What is known of the objects beside their meshes. Otherwise it is found and logged."""

    mesh_scale: Annotated[
        PositiveOrNone,
        Doc("metres per unit of the meshes: 0.001 for millimetres; null: guessed from the size"),
    ] = None
    symmetries: Annotated[
        Literal["found", "none"],
        Doc("found: turns that leave shape and colours nearly alike; none: it is asymmetric"),
    ] = "found"
    colors: Annotated[
        bool, Doc("false: the colours of the meshes are not those of the real objects")
    ] = True
    holistic_size_mm: Annotated[
        PositiveOrNone, Doc("side of the windows; null: computed from the mesh")
    ] = None
    local_size_mm: Annotated[
        PositiveOrNone, Doc("side of the local patches; null: computed from the mesh")
    ] = None
    farthest_mm: Annotated[
        Positive, Doc("largest distance from the camera; for warnings of hard objects alone")
    ] = 1000.0


def build_models(
    meshes: Mapping[str, Path], choices: Mapping[str, MeshChoices], first_id: int
) -> dict[int, ObjectModel]:
    """Object models of mesh files by id, numbered from `first_id` in the order given.

    Meshes and choices are by the objects' names. Raises InputError for a name that cannot name a
    folder, and the errors of loading a mesh.
    """
    if not meshes:
        raise InputError("no mesh is given: name one at least, {'bracket': 'bracket.ply'}")
    check_distinct(meshes)
    models = {}
    for object_id, (name, path) in enumerate(meshes.items(), first_id):
        if not NAME.fullmatch(name):
            raise InputError(
                f"object name {name!r}: use up to 80 letters, digits, blanks and _ . + -"
            )
        own = choices[name]
        sizes = ObjectSettings(object_id, own.holistic_size_mm, own.local_size_mm)
        stated = np.eye(4)[None] if own.symmetries == "none" else None
        model = build_object_model(
            name, sizes, Path(path), own.mesh_scale, _PROXY_FACES, symmetries=stated
        )
        if not own.colors:
            grey, proxy = (replace(mesh, colored=False) for mesh in (model.mesh, model.proxy))
            model = replace(model, mesh=grey, proxy=proxy)
        for sentence in hard_parts(model, own.farthest_mm):
            _logger.warning("%s: warning: %s", name, sentence)
        models[object_id] = model
    return models


def check_distinct(names: Iterable[str]) -> None:
    """Raise InputError for names whose folders are one where case does not count."""
    found: dict[str, str] = {}
    for name in names:
        if (other := found.setdefault(name.casefold(), name)) != name:
            raise InputError(f"object names {other!r} and {name!r} differ only in case")


def hard_parts(model: ObjectModel, farthest_mm: float) -> list[str]:
    """A sentence for each thing that makes an object hard at a distance of up to `farthest_mm`.

    It says why, and what would help.
    """
    hard = []
    thickness = _thickness(model.proxy.vertices) * MILLIMETRES_PER_METRE
    error = depth_error(farthest_mm * MILLIMETRE) * MILLIMETRES_PER_METRE
    if thickness < _LEAST_THICKNESS * error:
        nearer = farthest_mm * np.sqrt(thickness / (_LEAST_THICKNESS * error))
        hard.append(
            f"it is {thickness:.0f} mm thick, and depth is off by {error:.1f} mm at "
            f"{farthest_mm:.0f} mm: on a plane it hardly stands out. A camera within "
            f"{nearer:.0f} mm helps, or one with more exact depth"
        )
    size = _FOCAL * model.diameter / (farthest_mm * MILLIMETRE)
    if size < _LEAST_PX:
        hard.append(
            f"it is about {size:.0f} px large at {farthest_mm:.0f} mm, and less than "
            f"{_LEAST_PX:.0f} px are missed more often. A camera within "
            f"{farthest_mm * size / _LEAST_PX:.0f} mm or one with more pixels for the same view "
            "helps"
        )
    if _is_thin(model, farthest_mm):
        hard.append(
            f"most of it is less than {_WIDE} px wide at {farthest_mm:.0f} mm: cameras lose depth "
            "at edges, and little else is left. A nearer camera helps"
        )
    if _is_round(model):
        hard.append(
            "it is like a ball: hardly any turn changes what a camera sees, so only its place can "
            "be right. Colours in the mesh help, if the real object has them"
        )
    return hard


def _is_thin(model: ObjectModel, farthest_mm: float) -> bool:
    """Whether most of its silhouettes vanish when they are made narrower."""
    distance = max(farthest_mm * MILLIMETRE, model.diameter)
    rotations = view_rotations(thomson(_VIEWS, 0), np.zeros(1))
    poses = rigid(rotations, np.array([0.0, 0.0, distance]) - rotations @ model.centroid)
    side = int(np.ceil(1.2 * _FOCAL * model.diameter / (distance - model.diameter / 2))) + 2
    camera = np.array([[_FOCAL, 0.0, side / 2], [0.0, _FOCAL, side / 2], [0.0, 0.0, 1.0]])
    seen = (render_depth(model.mesh, poses, camera, (side, side)) > 0.0).astype(np.uint8)
    window = np.ones((_WIDE, _WIDE), np.uint8)
    wide = [np.count_nonzero(cv2.morphologyEx(view, cv2.MORPH_OPEN, window)) for view in seen]
    return bool(sum(wide) < np.count_nonzero(seen) / 2)


def _is_round(model: ObjectModel) -> bool:
    """Whether all of its surface is equally far from its middle; colours would tell turns apart."""
    points = sample_surface(model.mesh, _POINTS).points
    small, large = np.quantile(np.linalg.norm(points - model.centroid, axis=1), (0.05, 0.95))
    return bool(not model.mesh.colored and small >= _ROUND * large)


def _thickness(vertices: np.ndarray) -> float:
    """The least distance (m) of two parallel planes that the vertices lie between."""
    from scipy.spatial import ConvexHull, QhullError

    try:
        hull = ConvexHull(vertices)
    except QhullError:
        return 0.0
    return float(np.ptp(vertices[hull.vertices] @ hull.equations[:, :3].T, axis=0).min())
