"""Object models of CAD files, named and numbered, as learning takes them."""

import logging
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from annotated_types import Gt

from hlp.errors import InputError
from hlp.method.learn.hard_parts import hard_parts
from hlp.method.learn.learnt_folder import NAME
from hlp.objects.object_model import ObjectSettings, build_object_model
from hlp.records import ObjectModel
from hlp.settings import Doc, Settings

_PROXY_FACES = 500  # triangles of the mesh that the refiner renders
_logger = logging.getLogger(__name__)


@dataclass(frozen=True, kw_only=True)
class MeshChoices(Settings):
    """What is known of the objects beside their meshes. Otherwise it is found and logged."""

    mesh_scale: Annotated[
        float | None,
        Gt(0),
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
        float | None, Gt(0), Doc("side of the windows; null: computed from the mesh")
    ] = None
    local_size_mm: Annotated[
        float | None, Gt(0), Doc("side of the local patches; null: computed from the mesh")
    ] = None
    farthest_mm: Annotated[
        float, Gt(0), Doc("largest distance from the camera; for warnings of hard objects alone")
    ] = 1000.0


def build_models(
    meshes: Mapping[str, Path],
    choices: MeshChoices,
    first_id: int,
    own_choices: Mapping[str, MeshChoices] | None = None,
) -> dict[int, ObjectModel]:
    """Object models of mesh files by id, numbered from `first_id` in the order given.

    `own_choices` are those of single meshes by name, in place of `choices`.

    Raises InputError for a name that cannot name a folder, and the errors of loading a mesh.
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
        own = (own_choices or {}).get(name, choices)
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
        other = found.setdefault(name.casefold(), name)
        if other != name:
            raise InputError(f"object names {other!r} and {name!r} differ only in case")
