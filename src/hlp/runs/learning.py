"""`hlp learn`: objects from CAD models into a folder, with a user's own backgrounds."""

import logging
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from hlp.data.file_frames import FolderSettings
from hlp.method.learn import learning
from hlp.method.learn.learnt_folder import RECORD, read_record
from hlp.method.learn.mesh_models import MeshChoices, build_models
from hlp.method.settings import MethodSettings
from hlp.runs.learnt_cache import describe_learnt

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


def learn_into(folder: Path, request: LearningRequest) -> Path:
    """Learn objects into a new folder. Raises what learning raises; says what it found and made."""
    models = build_models(request.meshes, request.choices, 1, request.own_choices)
    backgrounds = request.backgrounds.training_images()
    learning.learn(models, folder, request.settings, backgrounds)
    _say_what(folder)
    return folder


def learn_once(cache: Path, request: LearningRequest) -> Path:
    """The folder in the cache for exactly this request; learns the objects if there is none."""
    models = build_models(request.meshes, request.choices, 1, request.own_choices)
    backgrounds = request.backgrounds.training_images()
    identity = learning.learning_request(models, request.settings, backgrounds)["made_from"]
    folder = cache / f"{'+'.join(request.meshes)}-{identity[:8]}"
    if (folder / RECORD).is_file():
        read_record(folder)
        _logger.info("learnt before: %s", folder)
        return folder
    learning.learn(models, folder, request.settings, backgrounds)
    _say_what(folder)
    return folder


def _say_what(folder: Path) -> None:
    entry = describe_learnt(folder)
    names = ", ".join(entry.objects)
    _logger.info("%s: %s, %.0f MB", names, folder, entry.size / 1e6)
