"""`hlp learn`: objects from CAD models into a folder, with a user's own backgrounds."""

import logging
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from jaxtyping import UInt8

from hlp.data.photographs import photograph_crops
from hlp.data.training_images import FolderSettings, TrainingImages
from hlp.errors import ConfigError
from hlp.method.learn import learning
from hlp.method.learn.learnt_folder import RECORD, read_record
from hlp.method.learn.mesh_models import MeshChoices, build_models
from hlp.method.settings import MethodSettings
from hlp.patches.procedural_backgrounds import procedural_backgrounds
from hlp.records import Frame
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


@dataclass(frozen=True)
class FolderBackgrounds:
    """Photographs and RGB-D frames in folders, as learning takes backgrounds."""

    images: TrainingImages

    def photograph_crops(
        self, count: int, size: int, rng: np.random.Generator
    ) -> UInt8[np.ndarray, "n s s 3"]:
        """Random square crops (RGB) of the photographs, or procedural ones."""
        if self.images.photographs is None:
            return procedural_backgrounds(count, size, rng)
        return photograph_crops(self.images.photographs, count, size, rng)

    def load_background_frames(self) -> Sequence[Frame]:
        """RGB-D frames of rooms; may be empty."""
        rooms = self.images.rooms
        return [] if rooms is None else [rooms.load(key) for key in rooms.keys]

    def load_encoder_frames(self) -> Sequence[Frame]:
        """RGB-D frames that train the autoencoder. Raises ConfigError if there are none."""
        frames = self.images.rgbd_frames
        if frames is None:
            raise ConfigError("encoder=cae trains on RGB-D frames: give rgbd_frames=FOLDER")
        return [frames.load(key) for key in frames.keys]


def learn_into(folder: Path, request: LearningRequest) -> Path:
    """Learn objects into a new folder. Raises what learning raises; says what it found and made."""
    models = build_models(request.meshes, request.choices, 1, request.own_choices)
    backgrounds = FolderBackgrounds(request.backgrounds.training_images())
    learning.learn(models, folder, request.settings, backgrounds)
    _say_what(folder)
    return folder


def learn_once(cache: Path, request: LearningRequest) -> Path:
    """The folder in the cache for exactly this request; learns the objects if there is none."""
    models = build_models(request.meshes, request.choices, 1, request.own_choices)
    backgrounds = FolderBackgrounds(request.backgrounds.training_images())
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
