"""Object models of a BOP data set: `models/obj_%06d.ply` and `models_info.json` (millimetres).

Format: Hodan et al., BOP (ECCV 2018), docs/bop_datasets_format.md of the BOP toolkit.
"""

from collections.abc import Mapping
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
        stated = _states_symmetries(path.parent)
        symmetries = symmetry_motions(info, symmetry_steps) if stated else None
        models[settings.id] = build_object_model(
            name, settings, path, MILLIMETRE, proxy_faces, diameter, symmetries
        )
    return models


def symmetry_motions(info: dict[str, Any], steps: int) -> Float[np.ndarray, "n 4 4"]:
    """Symmetries in an entry of `models_info.json` as motions (n, 4, 4) in metres, identity first.

    Each continuous symmetry, discretised in `steps`, is combined with each discrete one. Raises
    ValueError if `steps` < 1.
    """
    if steps < 1:
        raise ConfigError(f"symmetry_steps must be at least 1, not {steps}")
    discrete = [np.eye(4)]
    for values in info.get("symmetries_discrete", []):
        motion = np.asarray(values, dtype=np.float64).reshape(4, 4)
        discrete.append(rigid(nearest_rotation(motion[:3, :3]), motion[:3, 3] * MILLIMETRE))
    motions = np.stack(discrete)
    for entry in info.get("symmetries_continuous", []):
        axis = np.asarray(entry["axis"], dtype=np.float64)
        angles = np.arange(steps)[:, None] * (2.0 * np.pi / steps)
        turns = Rotation.from_rotvec(angles * axis / np.linalg.norm(axis)).as_matrix()
        offset = np.asarray(entry["offset"], dtype=np.float64) * MILLIMETRE
        continuous = rigid(turns, offset - turns @ offset)
        motions = np.einsum("aij,bjk->baik", continuous, motions).reshape(-1, 4, 4)
    return motions


def _mesh_path(root: Path, name: str, object_id: int) -> Path:
    tried = [root / folder / f"obj_{object_id:06d}.ply" for folder in _FOLDERS]
    for path in tried:
        if path.is_file():
            return path
    raise MissingFileError(
        f"no mesh of object {object_id} ({name}), tried "
        f"{' and '.join(str(path) for path in tried)}: check data.root, or drop it with "
        f"~data.objects.{name}"
    )


def _states_symmetries(folder: Path) -> bool:
    """Whether `models_info.json` states a symmetry of any object."""
    path = folder / "models_info.json"
    entries = read_json(path).values() if path.is_file() else ()
    return any(key.startswith("symmetries_") for entry in entries for key in entry)


def _model_info(folder: Path, object_id: int) -> dict[str, Any]:
    path = folder / "models_info.json"
    if not path.is_file():
        return {}
    info: dict[str, Any] = read_json(path).get(str(object_id), {})
    if "diameter" in info and not 0 < float(info["diameter"]) < float("inf"):
        raise DataError(f"{path}: diameter {info['diameter']} of object {object_id}")
    return info
