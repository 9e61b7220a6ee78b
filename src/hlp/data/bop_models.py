"""Object models of a BOP data set: `models/obj_%06d.ply` and `models_info.json` (millimetres).

Format: Hodan et al., BOP (ECCV 2018), docs/bop_datasets_format.md of the BOP toolkit.
"""

import re
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Float

from hlp import schemas
from hlp.arrays import Pose, Poses
from hlp.data.bop_scenes import list_scenes
from hlp.errors import ConfigError, DataError, MissingFileError
from hlp.files import read_json
from hlp.geometry import rigid, transform
from hlp.objects.meshes import mesh_diameter
from hlp.objects.object_model import ObjectSettings, build_object_model
from hlp.records import MILLIMETRE, MILLIMETRES_PER_METRE, ObjectModel
from hlp.rendering.surface import sample_surface
from hlp.schemas import exact_rotation
from hlp.settings import read_as, stored_as

_FOLDERS = ("models", "models_cad", "models_eval")
_INFO = "models_info.json"
_NAMES = "names.json"
_NAME = re.compile(r"\w[\w .+-]*")  # it becomes the name of files
_SYMMETRIES = {"symmetries_discrete", "symmetries_continuous"}
_MOST_MOTIONS = 10000
_ROUNDING = 0.01  # of symmetries, which people write by hand


def load_object_models(
    root: Path, objects: Mapping[str, ObjectSettings], proxy_faces: int, symmetry_steps: int
) -> dict[int, ObjectModel]:
    """Object models by id, from the first of `_FOLDERS` that has them. `models_eval` lacks colours.

    Diameters and symmetries come from `models_info.json` if there is one; continuous symmetries are
    discretised into `symmetry_steps` rotations. A file that states no symmetry of any object says
    nothing about them: then they are found in the meshes. Raises FileNotFoundError naming the
    object and the paths tried, what `build_object_model` raises, and DataError for a diameter or a
    symmetry that is not the mesh's.
    """
    models = {}
    for name, settings in objects.items():
        path = _mesh_path(root, name, settings.id)
        listed = path.parent / _INFO
        content = read_json(listed) if listed.is_file() else {}
        infos = stored_as(dict[str, schemas.ModelInfo], content, str(listed))
        info = infos.get(str(settings.id), schemas.ModelInfo())
        diameter = None if info.diameter is None else info.diameter * MILLIMETRE
        where = f"{listed}, object {settings.id}"
        stated = any(_SYMMETRIES & entry.keys() for entry in content.values())
        symmetries = symmetry_motions(info, symmetry_steps, where) if stated else None
        model = build_object_model(
            name, settings, path, MILLIMETRE, proxy_faces, diameter, symmetries
        )
        if diameter is not None:
            check_diameter(model, where)
        if symmetries is not None:
            check_symmetries(model, where)
        models[settings.id] = model
    return models


def symmetry_motions(info: schemas.ModelInfo, steps: int, where: str = "models_info.json") -> Poses:
    """Symmetries in an entry of `models_info.json` as motions (n, 4, 4) in metres, identity first.

    As in the BOP toolkit, the rotations about all axes of continuous symmetries, discretised in
    `steps`, form one set, and each of it is combined with each discrete symmetry; rotations about
    different axes are not combined. Raises DataError naming `where` if an entry has no rotation or
    axis, and ConfigError if there would be more than 10000 motions.
    """
    stated_discrete, stated_continuous = info.symmetries_discrete, info.symmetries_continuous
    count = (1 + len(stated_discrete)) * max(1, len(stated_continuous) * steps)
    if count > _MOST_MOTIONS:
        raise ConfigError(
            f"{where} states {len(stated_continuous)} continuous and"
            f" {len(stated_discrete)} discrete symmetries, {count} motions in"
            f" {steps} steps: at most {_MOST_MOTIONS} are possible, set data.symmetry_steps"
        )
    discrete = [np.eye(4)] + [
        _discrete(values, f"{where}: symmetries_discrete.{number}")
        for number, values in enumerate(stated_discrete)
    ]
    continuous = [
        _turns(entry, steps, f"{where}: symmetries_continuous.{number}.axis")
        for number, entry in enumerate(stated_continuous)
    ]
    about_axes = np.concatenate(continuous) if continuous else np.eye(4)[None]
    motions = np.einsum("aij,bjk->baik", about_axes, np.stack(discrete))
    return np.asarray(motions.reshape(-1, 4, 4))


def _discrete(values: Sequence[float], where: str) -> Pose:
    motion = np.asarray(values, dtype=np.float64).reshape(4, 4)
    if not np.array_equal(motion[3], [0.0, 0.0, 0.0, 1.0]):
        raise DataError(f"{where} is not rigid: its last row is {motion[3].tolist()}, not 0 0 0 1")
    rotation = exact_rotation(motion[:3, :3], where, _ROUNDING)
    return np.asarray(rigid(rotation, motion[:3, 3] * MILLIMETRE))


def _turns(entry: schemas.ContinuousSymmetry, steps: int, where: str) -> Float[np.ndarray, "s 4 4"]:
    """Rotations about the axis of a continuous symmetry, the identity first."""
    from scipy.spatial.transform import Rotation

    axis = np.asarray(entry.axis, dtype=np.float64)
    length = float(np.linalg.norm(axis))
    if length == 0:
        raise DataError(
            f"{where} is {list(entry.axis)}: it must be a direction of a positive length"
        )
    angles = np.arange(steps)[:, None] * (2.0 * np.pi / steps)
    turns = Rotation.from_rotvec(angles * axis / length).as_matrix()
    offset = np.asarray(entry.offset, dtype=np.float64) * MILLIMETRE
    return np.asarray(rigid(turns, offset - turns @ offset))


def name_objects(root: Path, object_ids: Iterable[int]) -> dict[str, ObjectSettings]:
    """Objects by the names in `models/names.json` (id -> name), or else as `obj_000005`.

    Raises ValueError if two objects share a name.
    """
    names: dict[str, str] = {}
    for folder in _FOLDERS:
        if not names and (path := root / folder / _NAMES).is_file():
            names = read_as(path, dict[str, str])
            for name in names.values():
                if not _NAME.fullmatch(name):
                    raise DataError(f"{path}: {name!r} cannot name an object")
    objects: dict[str, ObjectSettings] = {}
    for object_id in object_ids:
        name = names.get(str(object_id), f"obj_{object_id:06d}")
        if name in objects:
            raise DataError(f"{root}: {_NAMES} calls several objects {name!r}")
        objects[name] = ObjectSettings(id=object_id)
    return objects


def list_objects(root: Path) -> tuple[int, ...]:
    """Ids of all objects that have a mesh."""
    names = (path.stem for folder in _FOLDERS for path in (root / folder).glob("obj_*.ply"))
    return tuple(sorted({int(name[4:]) for name in names if name[4:].isdecimal()}))


def evaluation_meshes(root: Path, object_ids: Iterable[int]) -> dict[int, Path]:
    """Files in `models_eval`, on which BOP measures errors, of those objects that have one."""
    paths = {i: _file(root, _FOLDERS[-1], i) for i in object_ids}
    return {i: path for i, path in paths.items() if path.is_file()}


def _file(root: Path, folder: str, object_id: int) -> Path:
    return root / folder / f"obj_{object_id:06d}.ply"


def _mesh_path(root: Path, name: str, object_id: int) -> Path:
    paths = [_file(root, folder, object_id) for folder in _FOLDERS]
    found = next((path for path in paths if path.is_file()), None)
    if found is None:
        raise MissingFileError(
            f"no mesh of object {object_id} ({name}), tried "
            f"{', '.join(map(str, paths))}: check data.root and data.objects"
        )
    return found


AUTO = "auto"
"""The value of a setting that is to be found in the folder."""
_KINDS = ("test", "val")


def find_split(root: Path, split: str = AUTO) -> str:
    """The folder with the images to evaluate: `split`, or the first `split_*`, or as follows.

    `auto` is the first of `test`, `test_*`, `val` and `val_*` with true poses, or the first at all
    if none has them: BOP keeps the true poses of some of its test images private. Of cameras,
    Primesense comes first, by which BOP evaluates. Raises MissingFileError if there is no folder.
    """
    found = [
        folder.name
        for kind in (_KINDS if split == AUTO else (split,))
        for folder in sorted(root.glob(f"{kind}*"), key=lambda f: ("primesense" not in f.name, f))
        if folder.is_dir() and (folder.name == kind or folder.name.startswith(f"{kind}_"))
    ]
    if not found:
        named = "folder test, test_* or val" if split == AUTO else f"folder {split}"
        raise MissingFileError(f"{root} has no {named}: set data.split=NAME")
    if split != AUTO:
        return split if split in found else found[0]
    scenes = {name: list_scenes(root / name).values() for name in found}
    with_poses = [name for name in found if any(scene.annotated for scene in scenes[name])]
    return (with_poses or found)[0]


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
