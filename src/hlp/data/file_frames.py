"""What data sets in folders share: reading and checking of frames, folders for training."""

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any

import numpy as np

from hlp import schemas
from hlp.arrays import CameraMatrix, Values
from hlp.data import images
from hlp.data.dataset import StatedTarget, TrainingImages, content_hash
from hlp.data.frame_paths import with_frames
from hlp.data.own_frames import FrameFiles, OwnFrames
from hlp.errors import DataError, MissingFileError
from hlp.geometry import transform
from hlp.records import Frame, ObjectModel, Target, parse_frame_key
from hlp.settings import Count, Doc, Positive, Settings, read_settings

_MOST_MEGAPIXELS = 50.0


@dataclass(frozen=True)
class StatedFrame:
    """What the files state of a frame: its images, mm per unit of depth, camera and targets.

    `camera` and each target's text say where it stands; targets are in metres.
    """

    color: Path
    depth: Path
    depth_scale: float
    matrix: CameraMatrix
    camera: str
    targets: Sequence[tuple[Target, str]] = ()


@dataclass(eq=False)
class FileFrames(ABC):
    """Frames of two images and files with camera and true poses (a `FrameSource`).

    Constructing it reads no file. They are `CheckedFrames` too: only a bad frame is lost. `root` is
    the folder with all of them, `unit` that of the translations in the files.
    """

    root: Path
    max_megapixels: float = field(default=_MOST_MEGAPIXELS, kw_only=True)

    unit = "millimetres"

    @cached_property
    @abstractmethod
    def _entries(self) -> Mapping[str, Any]:
        """Frame keys, in order, and where a frame's files are."""

    @property
    def keys(self) -> tuple[str, ...]:
        """Frame keys, in order."""
        return tuple(self._entries)

    @abstractmethod
    def identity(self) -> str:
        """Hash of images, cameras, poses and settings, and of what is missing."""

    @abstractmethod
    def stated_targets(self, key: str) -> tuple[StatedTarget, ...]:
        """See `CheckedFrames`."""

    @abstractmethod
    def _stated(self, key: str) -> StatedFrame:
        """What the text files state. Raises MissingFileError, and DataError naming a broken one."""

    def load(self, key: str) -> Frame:
        """Decode one frame with its targets.

        Raises what `read` raises, and DataError naming the file for depths that no camera measures
        and poses that are not where the image has depth.
        """
        frame, stated = self.read(key), self._stated(key)
        schemas.require_depths(frame.depth, str(stated.depth))
        for target, where in stated.targets:
            center = target.pose_cam_obj[:3, 3]
            schemas.require_near_depths(center, frame.depth, frame.camera_matrix, where)
        return frame

    def read(self, key: str) -> Frame:
        """One frame as its files state it, whether that makes sense or not.

        Raises KeyError for an unknown key, MissingFileError, and DataError naming the file for a
        broken image, colour and depth of different sizes, or a pose that is none.
        """
        if key not in self._entries:
            raise KeyError(f"no frame {key!r} in {self.root}")
        stated = self._stated(key)
        rgb = images.read_rgb(stated.color)
        raw = images.read_raw_depth(stated.depth)
        depth = images.depth_metres(raw, stated.depth_scale, stated.depth)
        images.require_same_size(stated.color, rgb.shape[1::-1], depth.shape[::-1])
        targets = tuple(target for target, _ in stated.targets)
        return Frame(*parse_frame_key(key), rgb, depth, stated.matrix, targets)

    def check(self, key: str, models: Mapping[int, ObjectModel]) -> None:
        """See `CheckedFrames`."""
        stated = self._stated(key)
        size = images.image_size(stated.color, self.max_megapixels)
        depth_size = images.image_size(stated.depth, self.max_megapixels, depth=True)
        images.require_same_size(stated.color, size, depth_size)
        schemas.camera_matrix(stated.matrix, stated.camera, size)
        for target, where in stated.targets:
            if (model := models.get(target.object_id)) is not None:
                center = transform(target.pose_cam_obj, model.centroid[None])[0]
                schemas.require_in_front(center, model.diameter, where, self.unit)


def read_numbers(path: Path, count: int, header_lines: int = 0) -> Values:
    """The `count` numbers in a text file, after its header.

    Raises MissingFileError, and DataError for another number of values, NaN or infinity.
    """
    if not path.is_file():
        raise MissingFileError(f"no pose {path}")
    try:
        words = " ".join(path.read_text(encoding="utf-8").splitlines()[header_lines:]).split()
        values = np.array([schemas.number(word) for word in words])
    except ValueError as error:
        raise DataError(f"{path} holds something that is not a number ({error})") from error
    if len(values) != count or not np.isfinite(values).all():
        header = "a header line and " if header_lines else ""
        raise DataError(f"{path} must hold {header}{count} finite numbers")
    return values


class RgbdFrames(OwnFrames):
    """A plain folder of RGB-D frames without targets, for training: `rgb/`, `depth/`, camera.json.

    It is read as `hlp predict frames=FOLDER` reads it.
    """

    def __init__(self, root: Path) -> None:
        super().__init__(read_settings(FrameFiles, with_frames({"frames": str(root)})))

    def identity(self) -> str:
        """Hash of images and intrinsics."""
        pairs = [self.paths(key) for key in self.keys]
        files = [path for pair in pairs for path in (pair.color, pair.depth)]
        return content_hash([Path(str(self.settings.intrinsics)), *files])


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
    proxy_faces: Annotated[Count, Doc("triangles that the refiner draws (D)")] = 500
    max_megapixels: Annotated[
        Positive, Doc("larger images are taken for broken ones: 50 megapixels fill 1 GB (D)")
    ] = _MOST_MEGAPIXELS

    def training_images(self) -> TrainingImages:
        """The images in the folders. Decodes none.

        Raises MissingFileError naming a folder that is absent or empty.
        """
        folder = None
        if self.photographs is not None:
            folder = existing_folder("data.photographs", self.photographs)
            images.list_photographs(folder)
        return TrainingImages(
            photographs=folder,
            background_frames=_frames("data.rooms", self.rooms),
            encoder_frames=_frames("data.rgbd_frames", self.rgbd_frames),
        )


def existing_folder(key: str, path: str) -> Path:
    """The folder that a key names. Raises MissingFileError where it is absent."""
    if not Path(path).is_dir():
        raise MissingFileError(f"{key} is not a folder: {path} (set {key}=PATH)")
    return Path(path)


def _frames(key: str, path: str | None) -> RgbdFrames | None:
    if path is None:
        return None
    frames = RgbdFrames(existing_folder(key, path))
    len(frames)  # lists the images, so that errors in the folder are reported now
    return frames
