"""A data set: objects, frames to find them in, and images to train with."""

import hashlib
import os
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any, Protocol, runtime_checkable

import numpy as np

from hlp.arrays import ColorPatches, Mask
from hlp.data.images import list_photographs, photograph_crops
from hlp.errors import ConfigError, HlpError
from hlp.fingerprints import source_digest
from hlp.objects.meshes import load_mesh
from hlp.objects.object_model import mesh_identity, model_identity
from hlp.patches.backgrounds import procedural_backgrounds
from hlp.records import Frame, Mesh, ObjectModel, Target
from hlp.settings import Named, Registry


class FrameSource(Protocol):
    """An ordered set of RGB-D frames, loaded one at a time.

    `keys` are the frames' `Frame.key`, in order and unique; they are known without decoding images.
    A source may also have `visible_mask(frame, target)`: the pixels that show one of the frame's
    targets, or None if that is not known.
    """

    @property
    def keys(self) -> tuple[str, ...]:
        """Names of the frames, in order."""

    def load(self, key: str) -> Frame:
        """Decode one frame. Raises KeyError for an unknown key, ValueError for a broken file."""

    def identity(self) -> str:
        """Hash of all content that the frames are made from."""


def annotated_mask(source: FrameSource, frame: Frame, target: Target) -> Mask | None:
    """The data set's own mask of the pixels that show a target; None where it has none."""
    mask: Mask | None = getattr(source, "visible_mask", lambda *_: None)(frame, target)
    return mask


def content_hash(files: Sequence[Path], extra: str = "") -> str:
    """BLAKE2b over the bytes of the files in the given order, and `extra` (32 hex digits).

    File names are hashed without their folders, so that a data set can be moved. Of files that are
    missing, or may not be read, only the names count.
    """
    missing = [file.name for file in files if not os.access(file, os.R_OK)]
    digest = hashlib.blake2b((extra + (repr(missing) if missing else "")).encode(), digest_size=16)
    for file in files:
        if os.access(file, os.R_OK):
            digest.update(f"\0{file.name}\0{file.stat().st_size}\0".encode())
            digest.update(file.read_bytes())
    return digest.hexdigest()


class _DecodedFrames(Sequence[Frame]):
    """All frames of a source, each decoded whenever it is asked for, and not kept."""

    def __init__(self, source: FrameSource) -> None:
        self._source = source

    def __len__(self) -> int:
        return len(self._source.keys)

    def __getitem__(self, place: Any) -> Any:
        keys, load = self._source.keys[place], self._source.load
        return load(keys) if isinstance(keys, str) else [load(key) for key in keys]


@dataclass(frozen=True, kw_only=True)
class TrainingImages:
    """Images without any target object, which training takes.

    `photographs` is a folder (None: procedural backgrounds). `background_frames` are backgrounds of
    rendered objects, `encoder_frames` train the autoencoder; either may be None.
    """

    photographs: Path | None = None
    background_frames: FrameSource | None = None
    encoder_frames: FrameSource | None = None

    def photograph_crops(self, count: int, size: int, rng: np.random.Generator) -> ColorPatches:
        """Random square crops (RGB) of photographs, or procedural ones."""
        if self.photographs is None:
            return procedural_backgrounds(count, size, rng)
        return photograph_crops(self.photographs, count, size, rng)

    def load_background_frames(self) -> Sequence[Frame]:
        """RGB-D frames for backgrounds of objects in training; empty if there are none.

        None is held in memory: forty take a hundred megabytes.
        """
        return () if self.background_frames is None else _DecodedFrames(self.background_frames)

    def require_encoder_frames(self) -> FrameSource:
        """The frames that train the autoencoder. Raises ConfigError if there are none."""
        if self.encoder_frames is None:
            raise ConfigError(
                "encoder=cae trains on RGB-D frames (hlp learn: rgbd_frames=FOLDER): set "
                "data.rgbd_frames to a folder"
            )
        return self.encoder_frames

    def load_encoder_frames(self) -> list[Frame]:
        """The frames that train the autoencoder. Raises ConfigError if there are none."""
        source = self.require_encoder_frames()
        return [source.load(key) for key in source.keys]


@dataclass(frozen=True)
class Dataset(TrainingImages):
    """Objects by id, frames with targets, and frames without any target object.

    `models` are the classes of the classifier, `target_ids` those that are targets in the frames.
    With `search_all` every target object is looked for in every frame, its number of instances not
    being known, to count false alarms. `empty_frames` show no object. `settings` are those that the
    data set was built from; workers build it again from them. `evaluation_mesh_files` are meshes
    (mm) for BOP's errors; an object without one has its model's. `vsd_delta` is BOP's tolerance (m)
    of VSD for this data set.
    """

    models: dict[int, ObjectModel]
    target_ids: tuple[int, ...]
    frames: FrameSource
    search_all: bool = False
    settings: "DataSettings | None" = None
    evaluation_mesh_files: Mapping[int, Path] = field(default_factory=dict)
    empty_frames: FrameSource | None = None
    vsd_delta: float = 0.015

    @cached_property
    def evaluation_meshes(self) -> dict[int, Mesh]:
        """The meshes on which BOP's errors are measured, by object, where there are other ones."""
        return {i: load_mesh(path) for i, path in self.evaluation_mesh_files.items()}

    def in_empty_frames(self) -> "Dataset | None":
        """The same objects, to be looked for where none is; None if there are no such frames."""
        if self.empty_frames is None:
            return None
        return replace(self, frames=self.empty_frames, search_all=True, empty_frames=None)

    def instances_to_find(self, frame: Frame) -> dict[int, int]:
        """Objects to look for in a frame, by id, and the largest number of instances of each."""
        counts = Counter(target.object_id for target in frame.targets)
        if not counts and isinstance(self.frames, CheckedFrames):  # true poses may be private
            counts = Counter(object_id for object_id, _ in self.frames.stated_targets(frame.key))
        others = self.target_ids if self.search_all else ()
        return dict(counts) | {i: 1 for i in others if i not in counts}

    @property
    def names(self) -> dict[int, str]:
        """Names of all objects by id."""
        return {object_id: model.name for object_id, model in self.models.items()}

    @cached_property
    def mesh_identities(self) -> dict[int, str]:
        """Content hash of each object's full mesh, from which its views are rendered."""
        return {object_id: mesh_identity(model.mesh) for object_id, model in self.models.items()}

    @cached_property
    def model_identities(self) -> dict[int, str]:
        """Content hash of each object's geometry."""
        return {object_id: model_identity(model) for object_id, model in self.models.items()}

    @cached_property
    def frames_identity(self) -> str:
        """Content hash of the frames with targets."""
        return self.frames.identity()

    @cached_property
    def photographs_identity(self) -> str:
        """Content hash of the photographs, or of the code that draws procedural ones."""
        if self.photographs is None:
            return f"procedural {source_digest(procedural_backgrounds.__module__)}"
        return content_hash(list_photographs(self.photographs))


class DataSettings(Named, Protocol):
    """Settings of a data set."""

    def build(self) -> Dataset:
        """Objects and frames; reads meshes, decodes no image.

        Raises FileNotFoundError and ValueError naming the key or file that is wrong.
        """


DATASETS: Registry[DataSettings] = Registry("data", "hlp.data")
"""Alternatives of config group `data`."""


def frames_identity(source: FrameSource | None) -> str:
    """Content hash of optional frames."""
    return "none" if source is None else source.identity()


StatedTarget = tuple[int, float]
"""Id and visible fraction (nan where it is not stated) of an object that a frame should have."""


@runtime_checkable
class CheckedFrames(Protocol):
    """Frames read from files, which can be broken.

    Only the bad frame of such a source is lost, because its targets are known without it.
    """

    def check(self, key: str, models: Mapping[int, ObjectModel]) -> None:
        """Raise an `HlpError` that names the file and says what is wrong with a frame.

        Only what its text files and the beginnings of its images tell is checked. `models` are the
        data set's objects by id.
        """

    def stated_targets(self, key: str) -> tuple[StatedTarget, ...]:
        """The targets of a frame, as many as would have to be found in it if it were sound."""


def find_bad_frames(dataset: Dataset, keys: Sequence[str]) -> dict[str, str]:
    """The frames that cannot be used, and why.

    Frames are decoded up to the first sound one, so that what is wrong with all of them, as a unit
    of depth, is said at once.
    """
    source = dataset.frames
    if not isinstance(source, CheckedFrames):
        return {}
    reasons: dict[str, str] = {}
    sound: Frame | None = None
    for key in keys:
        try:
            source.check(key, dataset.models)
            sound = sound or source.load(key)
        except HlpError as error:
            reasons[key] = str(error)
    return reasons
