"""`hlp learn`: learn objects from CAD models into one folder."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from hlp.commands import composing, own_arguments
from hlp.errors import InputError

if TYPE_CHECKING:
    from hlp.runs.learning import LearningRequest

_PLACES = ("mesh", "names", "output", "name", "work")


def command(arguments: Sequence[str]) -> None:
    """Learn the objects and say where they are."""
    if not arguments or composing.HELP & set(arguments):
        print(LEARN_HELP)
        return
    own_arguments.call(lambda: _learn(arguments))


def _learn(arguments: Sequence[str]) -> None:
    given = own_arguments.split_arguments(arguments)
    own_arguments.check_mistyped(given, _PLACES, ["mesh"], "learn")
    if "mesh" not in given:
        raise InputError("mesh is not set: give mesh=FILE, see `hlp learn --help`")
    if "output" in given and "name" in given:
        raise InputError("output and name: give one of them")
    from hlp.runs.learning import learn_into
    from hlp.runs.learnt_cache import cache_folder

    request = learning_request(given, own_arguments.text_list(given["mesh"]), _PLACES)
    if "output" in given:
        folder = Path(given["output"]).expanduser()
    else:
        name = given.get("name", "+".join(request.meshes))
        if Path(name).name != name:
            raise InputError(f"name={name} is a path: give output={name}")
        folder = cache_folder(given.get("work")) / name
    learn_into(folder, request)
    shown = given.get("output", folder.name)
    print(f"Next: hlp predict learnt={shown} rgb=… depth=… intrinsics=…")


def learning_request(
    given: Mapping[str, str], meshes: Sequence[str], taken: Sequence[str]
) -> LearningRequest:
    """What to learn, and how, from arguments; those that nobody has taken are Hydra's overrides.

    Raises InputError for a missing mesh or names that do not fit, SettingsError for a wrong value.
    """
    from hlp.config.build import build_settings
    from hlp.data.file_frames import FolderSettings
    from hlp.errors import MissingFileError
    from hlp.method.learn.mesh_models import MeshChoices
    from hlp.runs.learning import LearningRequest

    paths = [Path(mesh) for mesh in meshes]
    for path in paths:
        if not path.is_file():
            raise MissingFileError(f"there is no mesh {path} (give a PLY, OBJ, STL or GLB file)")
    names = _object_names(given, paths)
    own = own_arguments.field_names(MeshChoices, FolderSettings) - {"name", "proxy_faces"}
    of_one = own_arguments.of_single(given, own_arguments.field_names(MeshChoices), names)
    known = {*own, *taken, *(f"{key}.{name}" for name in of_one for key in of_one[name])}
    rest = [f"{key}={value}" for key, value in given.items() if key not in known]
    # The built-in demo, the default, limits poses and learns from fewer images.
    general = ("output=none", "~experiment", "name=learn", "data=bop", "data.root=.")
    settings = build_settings(composing.compose_config(*general, *rest)).method
    return LearningRequest(
        meshes=dict(zip(names, paths, strict=True)),
        choices=own_arguments.read_group(MeshChoices, given),
        own_choices={
            name: own_arguments.read_group(MeshChoices, {**given, **values})
            for name, values in of_one.items()
        },
        backgrounds=own_arguments.read_group(
            FolderSettings, {key: given[key] for key in own & given.keys()}, name="files"
        ),
        settings=settings,
    )


def _object_names(given: Mapping[str, str], meshes: Sequence[Path]) -> list[str]:
    """The names that are given, or else those of the files; all different."""
    names = own_arguments.text_list(given["names"]) if "names" in given else []
    names = names or [path.stem for path in meshes]
    if len(names) != len(meshes) or len(set(names)) != len(names):
        raise InputError(
            f"names: {', '.join(names)} for {len(meshes)} meshes: give each mesh a name of its own"
        )
    return names


LEARN_HELP = """\
usage: hlp learn mesh=FILE[,FILE…] [output=FOLDER] [KEY=VALUE …]

Learns objects from their CAD models alone. This takes minutes and is done once;
afterwards `hlp predict learnt=FOLDER …` finds all of them in your frames.

  mesh         triangle meshes (PLY, OBJ, STL, GLB …), separated by commas
  output       a new folder, which can be copied to any machine; by default the
               objects are kept in the user's cache under their names
               (see `hlp objects`)
  names        names of the objects (default: those of the files)

Detected in the meshes; override for all of them or for one:
symmetries.bolt=none
  mesh_scale   metres per unit of the meshes: 1 for metres, 0.001 for
               millimetres
  symmetries   none: treat the object as asymmetric
  colors       false: the real objects have other colours than the meshes
  holistic_size_mm, local_size_mm    sides of windows and local patches

Detection works better with pictures of places like yours as training
backgrounds, without the objects in them:
  photographs  folder of images
  rooms        folder with rgb/, depth/ and camera.json

  name         name in the cache, instead of the objects' names
  work         folder in place of the user's cache

hlp learn mesh=bracket.ply,bolt.stl output=learnt/
hlp learn mesh=bracket.ply                 then: hlp predict learnt=bracket …
All groups and keys of the method can be changed too, as in `hlp run`, e.g.
encoder=pca; method=many_objects is for many objects in one image."""
