"""`hlp learn`: objects learnt from CAD models into a folder, or taken from those of a run."""

import logging
import shutil
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from hlp.codebook.entries import load_codebook
from hlp.codebook.neighbours import is_joint
from hlp.commands import arguments as own
from hlp.commands.composing import compose_config
from hlp.config.build import Run, build_settings
from hlp.data.dataset import TrainingImages
from hlp.data.file_frames import FolderSettings
from hlp.errors import InputError, MissingFileError
from hlp.files import expanded
from hlp.method.learn import learning, learnt_folder
from hlp.method.learn.mesh_models import MeshChoices, build_models
from hlp.method.learn.model_files import write_model
from hlp.method.learn.unfinished_folder import finish
from hlp.method.settings import MethodSettings
from hlp.records import ObjectModel
from hlp.runs.learnt_cache import cache_folder, describe_learnt
from hlp.stages.store import RECORD as STAGE
from hlp.stages.store import StageStore

_logger = logging.getLogger(__name__)


@dataclass(frozen=True)
class LearningRequest:
    """Objects, numbered from 1, what stands around them while they are learnt, and the method."""

    models: Mapping[int, ObjectModel]
    images: TrainingImages
    settings: MethodSettings

    @property
    def names(self) -> str:
        """All of the objects, joined."""
        return "+".join(model.name for model in self.models.values())


def learn_into(folder: Path, request: LearningRequest) -> Path:
    """Learn objects into a new folder. Raises what learning raises; says what it found and made."""
    count = len(request.models)
    needed = 0.4 + count, 1.1 + 0.07 * count  # as measured of one and of three objects
    _logger.info("learning takes about %.1f minutes of computing and %.1f GB", *needed)
    learning.learn(request.models, folder, request.settings, request.images)
    entry = describe_learnt(folder)
    _logger.info("%s: %s, %.0f MB", ", ".join(entry.objects), folder, entry.size / 1e6)
    return folder


def learn_once(cache: Path, request: LearningRequest) -> Path:
    """The folder in the cache for exactly this request; learns the objects if there is none."""
    made_from = learning.learning_request(request.models, request.settings, request.images)
    folder = cache / f"{request.names}-{made_from['made_from'][:8]}"
    if (folder / learnt_folder.RECORD).is_file():
        learnt_folder.read_record(folder)
        _logger.info("already learnt: %s", folder)
        return folder
    return learn_into(folder, request)


def learnt_of_run(run: Run, manifest: Path, folder: Path) -> None:
    """Copy the networks and codebooks that a manifest names into a new `folder`.

    They are those of the run itself, in its folder `work`; nothing is learnt again. Objects that
    the run did not look for have no codebook: the classifier alone knows them. Raises
    MissingFileError for an output that is no longer there, DataError for one that is damaged.
    """
    settings, known = run.settings.method, run.dataset.models
    models = {object_id: known[object_id] for object_id in run.dataset.target_ids}
    store = StageStore(Path(run.settings.work))

    def copy(stage: str, of: str, target: Path) -> None:
        source = store.named_by(manifest, stage, of).folder
        shutil.copytree(source, target, ignore=shutil.ignore_patterns(STAGE), dirs_exist_ok=True)

    copy("classifier", "", folder / learnt_folder.CLASSIFIER)
    copy("encoder", "", folder / learnt_folder.ENCODER)
    for model in models.values():
        own = folder / learnt_folder.OBJECTS / model.name
        copy("codebook", model.name, own)
        write_model(own, model)
        if not is_joint(settings.codebook):
            settings.codebook.prepare(load_codebook(own).features, settings.seed, own)
    ids = {model.name: object_id for object_id, model in models.items()}
    record = learnt_folder.LearntRecord(ids, tuple(sorted(known)), settings)
    learnt_folder.write_searches(folder, record)
    finish(folder, record)


_PLACES = ("mesh", "names", "output", "name", "work")


def learn(arguments: Sequence[str]) -> None:
    """Learn the objects and say where they are."""
    given = own.split_arguments(arguments)
    own.need(given, ["mesh"], _PLACES, "learn")
    if "output" in given and "name" in given:
        raise InputError("output and name: give one of them")
    request = learning_request(given, own.text_list(given["mesh"]), _PLACES)
    name = given.get("name", request.names)
    if "output" not in given and Path(name).name != name:
        raise InputError(f"name={name} is a path: give output={name}")
    folder = expanded(given.get("output", cache_folder(given.get("work")) / name))
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
    of_single = {f"{key}.{name}" for key in own.field_names(MeshChoices) for name in names}
    known = {*keys, *taken, *of_single}
    rest = [f"{key}={value}" for key, value in given.items() if key not in known]
    if unused := [word for word in rest if word.startswith("hydra.")]:
        raise InputError(f"{unused[0]}: nothing is run by Hydra here, give output=FOLDER")
    # The built-in demo, the default, limits poses and learns from fewer images.
    general = ("output=none", "~experiment", "name=learn", "data=bop", "data.root=.")
    settings = build_settings(compose_config(*general, *rest)).method
    images = own.read_group(FolderSettings, given, name="files").training_images()
    choices = {}
    for name in names:
        single = {key.removesuffix(f".{name}"): given[key] for key in given.keys() & of_single}
        choices[name] = own.read_group(MeshChoices, {**given, **single})
    models = build_models(dict(zip(names, paths, strict=True)), choices, 1)
    return LearningRequest(models, images, settings)


def _object_names(given: Mapping[str, str], meshes: Sequence[Path]) -> list[str]:
    """The names that are given, or else those of the files; all different."""
    names = own.text_list(given["names"]) if "names" in given else []
    names = names or [path.stem for path in meshes]
    if len(names) != len(meshes) or len(set(names)) != len(names):
        raise InputError(
            f"names: {', '.join(names)} for {len(meshes)} meshes: give each mesh a name of its own"
        )
    return names
