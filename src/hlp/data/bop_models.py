"""Object models of a BOP data set: `models/obj_%06d.ply` and `models_info.json` (millimetres).

Format: Hodan et al., BOP (ECCV 2018), docs/bop_datasets_format.md of the BOP toolkit.
"""

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from hlp.errors import ConfigError, DataError, MissingFileError
from hlp.files import read_json
from hlp.geometry import nearest_rotation, rigid
from hlp.objects.object_model import ObjectSettings, build_object_model, check_unique
from hlp.records import MILLIMETRE, ObjectModel

_FOLDERS = ("models", "models_eval")
_INFO = "models_info.json"
_NAMES = "names.json"
_MOST_MOTIONS = 10000


def load_object_models(
    root: Path, objects: Mapping[str, ObjectSettings], proxy_faces: int, symmetry_steps: int
) -> dict[int, ObjectModel]:
    """Object models by id, from `models` or else from `models_eval`, whose meshes lack colours.

    Diameters and symmetries come from `models_info.json` if there is one; continuous symmetries are
    discretised into `symmetry_steps` rotations. A file that states no symmetry of any object says
    nothing about them: then they are found in the meshes. Raises FileNotFoundError naming the
    object and the paths tried, and what `build_object_model` raises.
    """
    check_unique(objects)
    models = {}
    for name, settings in objects.items():
        path = _mesh_path(root, name, settings.id)
        info = _model_info(path.parent, settings.id)
        diameter = float(info["diameter"]) * MILLIMETRE if "diameter" in info else None
        where = f"{path.parent / _INFO}, object {settings.id}"
        stated = _states_symmetries(path.parent)
        symmetries = symmetry_motions(info, symmetry_steps, where) if stated else None
        models[settings.id] = build_object_model(
            name, settings, path, MILLIMETRE, proxy_faces, diameter, symmetries
        )
    return models


def symmetry_motions(
    info: dict[str, Any], steps: int, where: str = "models_info.json"
) -> Float[np.ndarray, "n 4 4"]:
    """Symmetries in an entry of `models_info.json` as motions (n, 4, 4) in metres, identity first.

    As in the BOP toolkit, the rotations about all axes of continuous symmetries, discretised in
    `steps`, form one set, and each of it is combined with each discrete symmetry; rotations about
    different axes are not combined. Raises ValueError if `steps` < 1, and one naming `where` if an
    entry is malformed or there would be more than 10000 motions.
    """
    if steps < 1:
        raise ConfigError(f"symmetry_steps must be at least 1, not {steps}")
    stated_discrete = info.get("symmetries_discrete", [])
    stated_continuous = info.get("symmetries_continuous", [])
    count = (1 + len(stated_discrete)) * max(1, len(stated_continuous) * steps)
    if count > _MOST_MOTIONS:
        raise ConfigError(
            f"{where} states {len(stated_continuous)} continuous and"
            f" {len(stated_discrete)} discrete symmetries, {count} motions in"
            f" {steps} steps: at most {_MOST_MOTIONS} are possible, set data.symmetry_steps"
        )
    try:
        discrete = [np.eye(4), *(_discrete(values) for values in stated_discrete)]
        continuous = [_turns(entry, steps) for entry in stated_continuous]
    except (KeyError, TypeError, ValueError) as error:
        raise DataError(f"{where}: a symmetry is malformed: {error!r}") from error
    about_axes = np.concatenate(continuous) if continuous else np.eye(4)[None]
    motions = np.einsum("aij,bjk->baik", about_axes, np.stack(discrete))
    return np.asarray(motions.reshape(-1, 4, 4))


def _discrete(values: Any) -> Float[np.ndarray, "4 4"]:
    motion = np.asarray(values, dtype=np.float64).reshape(4, 4)
    return np.asarray(rigid(nearest_rotation(motion[:3, :3]), motion[:3, 3] * MILLIMETRE))


def _turns(entry: dict[str, Any], steps: int) -> Float[np.ndarray, "s 4 4"]:
    """Rotations about the axis of a continuous symmetry, the identity first."""
    axis = np.asarray(entry["axis"], dtype=np.float64).reshape(3)
    length = float(np.linalg.norm(axis))
    if not 0 < length < np.inf:
        raise ValueError(f"axis {entry['axis']}")
    angles = np.arange(steps)[:, None] * (2.0 * np.pi / steps)
    turns = Rotation.from_rotvec(angles * axis / length).as_matrix()
    offset = np.asarray(entry["offset"], dtype=np.float64).reshape(3) * MILLIMETRE
    return np.asarray(rigid(turns, offset - turns @ offset))


def name_objects(root: Path, object_ids: Iterable[int]) -> dict[str, ObjectSettings]:
    """Objects by the names in `models/names.json` (id -> name), or else as `obj_000005`.

    Raises ValueError if two objects share a name.
    """
    names: dict[str, str] = {}
    for folder in _FOLDERS:
        if not names and (path := root / folder / _NAMES).is_file():
            names = {str(key): str(name) for key, name in read_json(path).items()}
    objects: dict[str, ObjectSettings] = {}
    for object_id in object_ids:
        name = names.get(str(object_id), f"obj_{object_id:06d}")
        if name in objects:
            raise DataError(f"{root}: {_NAMES} calls several objects {name!r}")
        objects[name] = ObjectSettings(id=object_id)
    return objects


def evaluation_meshes(root: Path, object_ids: Iterable[int]) -> dict[int, Path]:
    """Files in `models_eval`, on which BOP measures errors, of those objects that have one."""
    paths = {i: _file(root, _FOLDERS[1], i) for i in object_ids}
    return {i: path for i, path in paths.items() if path.is_file()}


def _file(root: Path, folder: str, object_id: int) -> Path:
    return root / folder / f"obj_{object_id:06d}.ply"


def _mesh_path(root: Path, name: str, object_id: int) -> Path:
    tried = [_file(root, folder, object_id) for folder in _FOLDERS]
    for path in tried:
        if path.is_file():
            return path
    raise MissingFileError(
        f"no mesh of object {object_id} ({name}), tried "
        f"{' and '.join(str(path) for path in tried)}: check data.root and data.objects"
    )


def _states_symmetries(folder: Path) -> bool:
    """Whether `models_info.json` states a symmetry of any object."""
    path = folder / _INFO
    entries = read_json(path).values() if path.is_file() else ()
    return any(key.startswith("symmetries_") for entry in entries for key in entry)


def _model_info(folder: Path, object_id: int) -> dict[str, Any]:
    path = folder / _INFO
    if not path.is_file():
        return {}
    info: dict[str, Any] = read_json(path).get(str(object_id), {})
    if "diameter" in info and not 0 < float(info["diameter"]) < float("inf"):
        raise DataError(f"{path}: diameter {info['diameter']} of object {object_id}")
    return info
