"""Folders of images without any target object, which a data set names for training."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from annotated_types import Ge, Gt

from hlp.data.dataset import Dataset, DataSettings, FrameSource
from hlp.data.photographs import list_photographs
from hlp.data.rgbd_frames import RgbdFrames
from hlp.errors import MissingFileError
from hlp.records import ObjectModel
from hlp.settings import Doc, Settings

MAX_MEGAPIXELS = 50.0


@dataclass(frozen=True)
class TrainingImages:
    """Photographs, RGB-D frames of rooms and RGB-D scenes that train the autoencoder."""

    photographs: Path | None
    rooms: FrameSource | None
    rgbd_frames: FrameSource | None

    def dataset(
        self,
        models: Mapping[int, ObjectModel],
        target_ids: tuple[int, ...],
        frames: FrameSource,
        settings: DataSettings,
    ) -> Dataset:
        """A data set of these objects and frames that trains with these images."""
        return Dataset(
            dict(models),
            target_ids,
            frames,
            self.photographs,
            self.rooms,
            self.rgbd_frames,
            settings=settings,
        )


@dataclass(frozen=True, kw_only=True)
class FolderSettings(Settings):
    """What all data sets read from folders can be given beside their own frames."""

    name: str
    photographs: Annotated[
        str | None,
        Doc("folder of backgrounds of training patches (P: PASCAL VOC); null: procedural ones (D)"),
    ] = None
    rgbd_frames: Annotated[
        str | None, Doc("folder of RGB-D scenes that train the autoencoder (P); encoder=cae alone")
    ] = None
    rooms: Annotated[
        str | None, Doc("folder of RGB-D frames without any object, backgrounds with depth (D)")
    ] = None
    proxy_faces: Annotated[
        int, Ge(1), Doc("triangles of the mesh that the refiner renders (D)")
    ] = 500
    max_megapixels: Annotated[
        float, Gt(0), Doc("larger images are taken for broken ones: 50 megapixels fill 1 GB (D)")
    ] = MAX_MEGAPIXELS

    def training_images(self) -> TrainingImages:
        """The images in the folders. Decodes none.

        Raises MissingFileError naming a folder that is absent or empty.
        """
        folder = None
        if self.photographs is not None:
            folder = existing_folder("data.photographs", self.photographs)
            list_photographs(folder)
        rooms = _frames("data.rooms", self.rooms)
        return TrainingImages(folder, rooms, _frames("data.rgbd_frames", self.rgbd_frames))


def existing_folder(key: str, path: str) -> Path:
    """The folder that a key names. Raises MissingFileError where it is absent."""
    if not Path(path).is_dir():
        raise MissingFileError(f"{key} is no folder: {path} (set {key}=PATH)")
    return Path(path)


def _frames(key: str, path: str | None) -> FrameSource | None:
    if path is None:
        return None
    frames = RgbdFrames(existing_folder(key, path))
    len(frames)  # lists the images, so that errors in the folder are reported now
    return frames
