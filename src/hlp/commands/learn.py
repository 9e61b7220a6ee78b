"""`hlp learn`: learn objects from CAD models into one folder."""

from collections.abc import Mapping, Sequence
from pathlib import Path

from hlp.commands import arguments as own
from hlp.commands.composing import compose_config
from hlp.config.build import build_settings
from hlp.data.file_frames import FolderSettings
from hlp.errors import InputError, MissingFileError
from hlp.method.learn.mesh_models import MeshChoices
from hlp.runs.learning import LearningRequest, learn_into
from hlp.runs.learnt_cache import cache_folder

_PLACES = ("mesh", "names", "output", "name", "work")


def learn(arguments: Sequence[str]) -> None:
    """Learn the objects and say where they are."""
    given = own.split_arguments(arguments)
    own.check_mistyped(given, _PLACES, ["mesh"], "learn")
    if "mesh" not in given:
        raise InputError("mesh is not set: give mesh=FILE, see `hlp learn --help`")
    if "output" in given and "name" in given:
        raise InputError("output and name: give one of them")
    request = learning_request(given, own.text_list(given["mesh"]), _PLACES)
    name = given.get("name", "+".join(request.meshes))
    if "output" not in given and Path(name).name != name:
        raise InputError(f"name={name} is a path: give output={name}")
    folder = own.path_of(given, "output", cache_folder(given.get("work")) / name)
    learn_into(folder, request)
    shown = given.get("output", folder.name)
    print(f"Next: hlp predict learnt={shown} rgb=… depth=… intrinsics=…")


def learning_request(
    given: Mapping[str, str], meshes: Sequence[str], taken: Sequence[str]
) -> LearningRequest:
    """What to learn, and how, from arguments; those that nobody has taken are Hydra's overrides.

    Raises InputError for a missing mesh or names that do not fit, SettingsError for a wrong value.
    """
    paths = [Path(mesh) for mesh in meshes]
    for path in paths:
        if not path.is_file():
            raise MissingFileError(f"there is no mesh {path} (give a PLY, OBJ, STL or GLB file)")
    names = _object_names(given, paths)
    keys = own.field_names(MeshChoices, FolderSettings) - {"name", "proxy_faces"}
    of_one = own.of_single(given, own.field_names(MeshChoices), names)
    known = {*keys, *taken, *(f"{key}.{name}" for name in of_one for key in of_one[name])}
    rest = [f"{key}={value}" for key, value in given.items() if key not in known]
    # The built-in demo, the default, limits poses and learns from fewer images.
    general = ("output=none", "~experiment", "name=learn", "data=bop", "data.root=.")
    return LearningRequest(
        meshes=dict(zip(names, paths, strict=True)),
        choices=own.read_group(MeshChoices, given),
        own_choices={
            name: own.read_group(MeshChoices, {**given, **values})
            for name, values in of_one.items()
        },
        backgrounds=own.read_group(
            FolderSettings, {key: given[key] for key in keys & given.keys()}, name="files"
        ),
        settings=build_settings(compose_config(*general, *rest)).method,
    )


def _object_names(given: Mapping[str, str], meshes: Sequence[Path]) -> list[str]:
    """The names that are given, or else those of the files; all different."""
    names = own.text_list(given["names"]) if "names" in given else []
    names = names or [path.stem for path in meshes]
    if len(names) != len(meshes) or len(set(names)) != len(names):
        raise InputError(
            f"names: {', '.join(names)} for {len(meshes)} meshes: give each mesh a name of its own"
        )
    return names
