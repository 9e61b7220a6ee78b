"""Folders of images without any target object, which a data set names for training."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from hlp.data.dataset import Dataset, DataSettings
from hlp.data.photographs import list_photographs
from hlp.data.rgbd_frames import RgbdFrames
from hlp.data.sources import FrameSource
from hlp.errors import MissingFileError
from hlp.records import ObjectModel


@dataclass(frozen=True)
class TrainingImages:
    """Photographs, RGB-D frames of rooms and RGB-D scenes that train the autoencoder."""

    photographs: Path | None
    rooms: FrameSource | None
    rgbd_frames: FrameSource | None

    @classmethod
    def of(
        cls, photographs: str | None, rooms: str | None, rgbd_frames: str | None
    ) -> "TrainingImages":
        """The images in folders; None for none. Decodes no image.

        Raises MissingFileError naming a folder that is absent or empty.
        """
        folder = None
        if photographs is not None:
            folder = existing_folder("data.photographs", photographs)
            list_photographs(folder)
        return cls(folder, _frames("data.rooms", rooms), _frames("data.rgbd_frames", rgbd_frames))

    def dataset(
        self,
        models: Mapping[int, ObjectModel],
        target_ids: tuple[int, ...],
        frames: FrameSource,
        settings: DataSettings,
        annotated: bool = True,
    ) -> Dataset:
        """A data set of these objects and frames that trains with these images."""
        return Dataset(
            dict(models),
            target_ids,
            frames,
            self.photographs,
            self.rooms,
            self.rgbd_frames,
            annotated,
            settings=settings,
        )


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
