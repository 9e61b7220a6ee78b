"""Object models built from their settings and meshes, and hashes of their content.

The proxy is the decimated mesh that poses are drawn with: as few triangles as show the same object.
"""

import hashlib
import logging
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np

from hlp.arrays import Points, Poses
from hlp.errors import ConfigError
from hlp.geometry import rigid
from hlp.objects.meshes import decimate, load_mesh, mesh_diameter
from hlp.records import MILLIMETRE, MILLIMETRES_PER_METRE, Mesh, ObjectModel
from hlp.rendering.rasterizer import render_depth
from hlp.rendering.views import thomson, view_rotations
from hlp.settings import Doc, PositiveOrNone, Settings, WholeNumber

_VIEWS = 12  # in which a mesh and its decimated one are compared
_SIDE, _OBJECT = 112, 96  # px, of the image and of the diameter in it
_FOCAL = 1000.0  # px: the object is far away, so that no side of it is hidden
_OVERLAP = 0.85  # of both meshes' pixels; of 500 triangles of a scan it is .88 or more
_SAME = 0.998  # of them, with fewer triangles than asked for
_HALVED = 5  # how often the triangles asked for are halved, at most
_NEAR = 0.01  # of the diameter: pixels whose depths differ by more do not count as the same
_logger = logging.getLogger(__name__)


@dataclass(frozen=True)
class ObjectSettings(Settings):
    """One object of a data set."""

    id: Annotated[WholeNumber, Doc("id of the object in the data set")]
    holistic_size_mm: Annotated[
        PositiveOrNone, Doc("side of its windows; null: computed from its mesh")
    ] = None
    local_size_mm: Annotated[
        PositiveOrNone, Doc("side of its local patches; null: computed from its mesh")
    ] = None


ONLY = Doc("names of the objects that are learnt and looked for; null: all")


def build_object_model(
    name: str,
    settings: ObjectSettings,
    mesh_path: Path,
    scale: float | None,
    proxy_faces: int,
    diameter: float | None = None,
    symmetries: Poses | None = None,
) -> ObjectModel:
    """Load one object; `scale` is metres per unit of the mesh file, `diameter` in metres.

    With `scale` None the unit is guessed; the log states the size that the object has then. By
    default the diameter is the largest distance between two vertices, and the symmetries are found
    in the mesh: the motions that leave its shape nearly as it is and that its colours do not break.
    Those that they break are its near symmetries; with stated `symmetries`, all that these lack. A
    mesh without colours has none. Raises what `load_mesh` raises.
    """
    mesh = load_mesh(mesh_path, scale)
    if diameter is None:
        diameter = mesh_diameter(mesh.vertices)
    symmetries, near_symmetries = _symmetries(mesh, diameter, symmetries)
    holistic, local = settings.holistic_size_mm, settings.local_size_mm
    model = ObjectModel(
        object_id=settings.id,
        name=name,
        mesh=mesh,
        proxy=build_proxy(mesh, proxy_faces, diameter),
        diameter=diameter,
        symmetries=symmetries,
        holistic_size=holistic_size(mesh.vertices) if holistic is None else holistic * MILLIMETRE,
        local_size=local_size(diameter) if local is None else local * MILLIMETRE,
        near_symmetries=near_symmetries,
    )
    _log(model)
    return model


def _log(model: ObjectModel) -> None:
    name, mesh = model.name, model.mesh
    sides = np.ptp(mesh.vertices, axis=0) * MILLIMETRES_PER_METRE
    if not mesh.colored:
        _logger.info("%s has no colours: none are assumed in finding or verifying it", name)
    _logger.info("%s: %.0f × %.0f × %.0f mm, %d triangles", name, *sides, len(mesh.faces))
    _logger.info(
        "%s: %d symmetries; its colours tell %d more poses of nearly the same shape apart",
        *(name, len(model.symmetries) - 1, len(model.near_symmetries)),
    )


def _symmetries(mesh: Mesh, diameter: float, stated: Poses | None) -> tuple[Poses, Poses]:
    """Symmetries, with the identity, and what would be some without colours."""
    from hlp.objects.near_symmetries import find_near_symmetries, without

    near = find_near_symmetries(mesh, diameter)
    if stated is None:
        return np.concatenate([np.eye(4)[None], near.unbroken]), near.broken
    if not mesh.colored:
        return stated, near.broken
    return stated, without(np.concatenate([near.unbroken, near.broken]), stated)


def build_proxy(mesh: Mesh, faces: int, diameter: float) -> Mesh:
    """The mesh decimated to `faces` triangles, or twice as many as often as it takes to look alike.

    A mesh whose vertices carry no colours is decimated further, while it shows the very same shape.
    Scanned surfaces keep their shape; of a CAD model, whose large faces are few triangles already,
    whole walls may vanish: a proxy that lacks them fits no image of the object. `diameter` is in m.
    Raises ValueError for fewer than 4 faces.
    """
    rotations = view_rotations(thomson(_VIEWS, 0), np.zeros(1))  # from all sides
    middle = (mesh.vertices.min(axis=0) + mesh.vertices.max(axis=0)) / 2.0
    ahead = np.array([0.0, 0.0, _FOCAL * diameter / _OBJECT])
    poses = rigid(rotations, ahead - rotations @ middle)
    centre = (_SIDE - 1) / 2.0
    camera = np.array([[_FOCAL, 0.0, centre], [0.0, _FOCAL, centre], [0.0, 0.0, 1.0]])
    full = render_depth(mesh, poses, camera, (_SIDE, _SIDE))

    def alike(proxy: Mesh, share: float) -> bool:
        drawn = render_depth(proxy, poses, camera, (_SIDE, _SIDE))
        either, both = (full > 0.0) | (drawn > 0.0), (full > 0.0) & (drawn > 0.0)
        same = both & (np.abs(full - drawn) <= _NEAR * diameter)
        return bool(np.count_nonzero(same) >= share * np.count_nonzero(either))

    count, proxy = faces, decimate(mesh, faces)
    while proxy is not mesh and not alike(proxy, _OVERLAP):
        proxy = decimate(mesh, count := 2 * count)
    if count > faces:
        _logger.info("drawn with %d triangles: %d lose its shape", len(proxy.faces), faces)
    while not mesh.colored and max(faces >> _HALVED, 4) <= count // 2 < faces:
        if not alike(fewer := decimate(mesh, count // 2), _SAME):
            break
        count, proxy = count // 2, fewer
    return proxy


def chosen_objects(
    objects: Mapping[str, ObjectSettings], only: Sequence[str] | None
) -> dict[str, ObjectSettings]:
    """Those that `only` names; None: all. Raises ConfigError for none, and if two share an id."""
    if not (objects if only is None else only and objects.keys() >= {*only}):
        named = "" if only is None else f"; data.only={[*only]} must be some of {[*objects]}"
        raise ConfigError(f"data.objects names no object{named}")
    names: dict[int, str] = {}
    for name, settings in objects.items():
        if (other := names.setdefault(settings.id, name)) != name:
            raise ConfigError(f"data.objects: {other} and {name} have one id")
    return {name: objects[name] for name in objects if only is None or name in only}


def model_identity(model: ObjectModel) -> str:
    """Hash of an object's id, meshes, diameter and (near) symmetries, not of its patch sizes."""
    digest = hashlib.blake2b(f"{model.object_id} {model.diameter!r}".encode(), digest_size=16)
    for part in (mesh_identity(model.mesh), mesh_identity(model.proxy)):
        digest.update(part.encode())
    for motions in (model.symmetries, model.near_symmetries):
        digest.update(f"\0{motions.shape}".encode())
        digest.update(np.ascontiguousarray(motions).tobytes())
    return digest.hexdigest()


def mesh_identity(mesh: Mesh) -> str:
    """Hash of a mesh's vertices, faces, colours, normals and texture."""
    digest = hashlib.blake2b(f"{mesh.colored}".encode(), digest_size=16)
    texture = () if mesh.texture is None else (mesh.texture.image, mesh.texture.uv)
    for array in (mesh.vertices, mesh.faces, mesh.colors, mesh.normals, *texture):
        digest.update(f"\0{array.dtype.str}{array.shape}".encode())
        digest.update(np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()


_HOLISTIC_FACTOR = 1.08
_HOLISTIC_LIMIT = 0.20
# From the paper: Ape 3 cm, Cam 4 cm, Driller 8 cm, with LINEMOD's diameters (m).
_LOCAL_DIAMETERS = (0.102, 0.172, 0.261)
_LOCAL_SIZES = (0.03, 0.04, 0.08)


def holistic_size(vertices: Points) -> float:
    """Side (m) of the holistic patch: 1.08 times the middle extent of the bounding box.

    At most 20 cm, rounded to the centimetre. In the paper: Ape 8, Driller 20, Bowl 18 cm.
    """
    middle = float(np.sort(np.ptp(vertices, axis=0))[1])
    return round(min(_HOLISTIC_FACTOR * middle, _HOLISTIC_LIMIT), 2)


def local_size(diameter: float) -> float:
    """Side (m) of the local patch: linear in the diameter (m) between the paper's three sizes.

    Constant beyond them, rounded to the millimetre.
    """
    return round(float(np.interp(diameter, _LOCAL_DIAMETERS, _LOCAL_SIZES)), 3)
