"""Folders of learnt objects: learnt from CAD models, or taken from what a run has learnt."""

import logging
import shutil
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

from hlp.codebook.entries import load_codebook
from hlp.codebook.neighbours import is_joint
from hlp.data.dataset import TrainingImages
from hlp.data.file_frames import FolderSettings
from hlp.errors import DataError, MissingFileError
from hlp.method.learn import learning
from hlp.method.learn.learnt_folder import (
    CLASSIFIER,
    ENCODER,
    OBJECTS,
    RECORD,
    LearntRecord,
    read_record,
    write_searches,
)
from hlp.method.learn.mesh_models import MeshChoices, build_models
from hlp.method.learn.model_files import write_model
from hlp.method.learn.unfinished_folder import finish
from hlp.method.settings import MethodSettings
from hlp.records import ObjectModel
from hlp.refinement.score_model import PRIOR, save_score_model
from hlp.runs.learnt_cache import describe_learnt
from hlp.stages.manifest import made_outputs
from hlp.stages.store import RECORD as STAGE
from hlp.stages.store import StageStore

if TYPE_CHECKING:
    from hlp.config.build import Run

_logger = logging.getLogger(__name__)


@dataclass(frozen=True, kw_only=True)
class LearningRequest:
    """Meshes by name, what is known of them, backgrounds, and settings of the method.

    `own_choices` are those of single meshes by name, in place of `choices`.
    """

    meshes: Mapping[str, Path]
    choices: MeshChoices = field(default_factory=MeshChoices)
    own_choices: Mapping[str, MeshChoices] = field(default_factory=dict)
    backgrounds: FolderSettings = field(default_factory=lambda: FolderSettings(name="files"))
    settings: MethodSettings = field(default_factory=MethodSettings)

    @cached_property
    def models(self) -> dict[int, ObjectModel]:
        """The objects, read from their meshes and numbered from 1."""
        return build_models(self.meshes, self.choices, 1, self.own_choices)

    @cached_property
    def images(self) -> TrainingImages:
        """What stands behind and before the objects while they are learnt."""
        return self.backgrounds.training_images()


def learn_into(folder: Path, request: LearningRequest) -> Path:
    """Learn objects into a new folder. Raises what learning raises; says what it found and made."""
    learning.learn(request.models, folder, request.settings, request.images)
    entry = describe_learnt(folder)
    _logger.info("%s: %s, %.0f MB", ", ".join(entry.objects), folder, entry.size / 1e6)
    return folder


def learn_once(cache: Path, request: LearningRequest) -> Path:
    """The folder in the cache for exactly this request; learns the objects if there is none."""
    made_from = learning.learning_request(request.models, request.settings, request.images)
    identity = made_from["made_from"]
    folder = cache / f"{'+'.join(request.meshes)}-{identity[:8]}"
    if (folder / RECORD).is_file():
        read_record(folder)
        _logger.info("learnt before: %s", folder)
        return folder
    return learn_into(folder, request)


def learnt_of_run(run: "Run", manifest: Path, folder: Path) -> None:
    """Copy the networks, codebooks and scores that a manifest names into a new `folder`.

    They are those of the run itself, in its folder `work`; nothing is learnt again. Objects that
    the run did not look for have no codebook: the classifier alone knows them. Raises
    MissingFileError for an output that is no longer there, DataError for one that is damaged.
    """
    settings, known = run.settings.method, run.dataset.models
    models = {object_id: known[object_id] for object_id in run.dataset.target_ids}
    store = StageStore(Path(run.settings.work))
    _copy_output(manifest, store, ("classifier", ""), folder / CLASSIFIER)
    _copy_output(manifest, store, ("encoder", ""), folder / ENCODER)
    for model in models.values():
        own = folder / OBJECTS / model.name
        _copy_output(manifest, store, ("codebook", model.name), own)
        write_model(own, model)
        if not is_joint(settings.codebook):
            settings.codebook.prepare(load_codebook(own).features, settings.seed, own)
        if settings.score.scenes == 0:
            save_score_model(own, PRIOR)
        else:
            _copy_output(manifest, store, ("score", model.name), own)
    ids = {model.name: object_id for object_id, model in models.items()}
    record = LearntRecord(ids, tuple(sorted(known)), settings)
    write_searches(folder, record)
    finish(folder, record)


def _copy_output(manifest: Path, store: StageStore, of: tuple[str, str], target: Path) -> None:
    """Copy the output of a stage (of an object), as a manifest names it."""
    stage, name = of[0], made_outputs(manifest).get(of, "")
    source = store.root / stage / name
    if not name or not source.is_dir():
        raise MissingFileError(
            f"{store.root} has no {' of '.join(filter(None, of))} that {manifest} names: name the"
            " folder of that run with work=FOLDER, or repeat it (hlp run manifest=…)"
        )
    try:
        store.read_record(stage, name)  # which compares the checksums
    except DataError as error:
        error.add_note(f"repeat the run of {manifest}, which makes it again")
        raise
    shutil.copytree(source, target, ignore=shutil.ignore_patterns(STAGE), dirs_exist_ok=True)
