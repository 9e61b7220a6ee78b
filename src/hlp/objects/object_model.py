"""Object models built from their settings and meshes, and hashes of their content."""

import hashlib
import logging
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
from annotated_types import Ge, Gt
from jaxtyping import Float

from hlp.errors import ConfigError
from hlp.objects.meshes import load_mesh, mesh_diameter
from hlp.objects.proxy import build_proxy
from hlp.records import MILLIMETRE, MILLIMETRES_PER_METRE, Mesh, ObjectModel
from hlp.settings import Doc, Settings

_logger = logging.getLogger(__name__)


@dataclass(frozen=True)
class ObjectSettings(Settings):
    """One object of a data set."""

    id: Annotated[int, Ge(0), Doc("id of the object in the data set")]
    holistic_size_mm: Annotated[
        float | None, Gt(0), Doc("side of its windows; null: computed from its mesh")
    ] = None
    local_size_mm: Annotated[
        float | None, Gt(0), Doc("side of its local patches; null: computed from its mesh")
    ] = None


def build_object_model(
    name: str,
    settings: ObjectSettings,
    mesh_path: Path,
    scale: float | None,
    proxy_faces: int,
    diameter: float | None = None,
    symmetries: Float[np.ndarray, "n 4 4"] | None = None,
) -> ObjectModel:
    """Load one object; `scale` is metres per unit of the mesh file, `diameter` in metres.

    With `scale` None the unit is guessed; the log states the size that the object has then.

    By default the diameter is the largest distance between two vertices, and the symmetries are
    found in the mesh: the motions that leave its shape nearly as it is and that its colours do not
    break. Those that they break are its siblings; with stated `symmetries`, all that these lack.
    A mesh without colours has no siblings.
    Raises what `load_mesh` raises.
    """
    from hlp.objects.near_symmetries import find_near_symmetries, without

    mesh = load_mesh(mesh_path, scale)
    if not mesh.colored:
        _logger.info(
            "%s has no colours: none are assumed, in finding it or in verifying its poses", name
        )
    if diameter is None:
        diameter = mesh_diameter(mesh.vertices)
    near = find_near_symmetries(mesh, diameter)
    siblings = near.broken
    if symmetries is None:
        symmetries = np.concatenate([np.eye(4)[None], near.unbroken])
    elif mesh.colored:
        siblings = without(np.concatenate([near.unbroken, near.broken]), symmetries)
    low, high = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
    _logger.info(
        "%s: %s mm, %d triangles",
        name,
        " × ".join(f"{side * MILLIMETRES_PER_METRE:.0f}" for side in high - low),
        len(mesh.faces),
    )
    _logger.info(
        "%s: %d symmetries; its colours tell %d more poses of nearly the same shape apart",
        name,
        len(symmetries) - 1,
        len(siblings),
    )
    holistic, local = settings.holistic_size_mm, settings.local_size_mm
    return ObjectModel(
        object_id=settings.id,
        name=name,
        mesh=mesh,
        proxy=build_proxy(mesh, proxy_faces, diameter),
        diameter=diameter,
        symmetries=symmetries,
        holistic_size=holistic_size(mesh.vertices) if holistic is None else holistic * MILLIMETRE,
        local_size=local_size(diameter) if local is None else local * MILLIMETRE,
        siblings=siblings,
    )


def check_unique(objects: Mapping[str, ObjectSettings]) -> None:
    """Raise ValueError if two objects share an id, or if there is no object."""
    if not objects:
        raise ConfigError("data.objects names no object")
    names: dict[int, str] = {}
    for name, settings in objects.items():
        if settings.id in names:
            raise ConfigError(f"data.objects: {names[settings.id]} and {name} have one id")
        names[settings.id] = name


def model_identity(model: ObjectModel) -> str:
    """Hash of an object's id, meshes, diameter, symmetries and siblings, not of its patch sizes."""
    digest = hashlib.blake2b(f"{model.object_id} {model.diameter!r}".encode(), digest_size=16)
    for part in (mesh_identity(model.mesh), mesh_identity(model.proxy)):
        digest.update(part.encode())
    for motions in (model.symmetries, model.siblings):
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


def holistic_size(vertices: Float[np.ndarray, "v 3"]) -> float:
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
