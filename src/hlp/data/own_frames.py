"""A user's own frames: colour and depth images or a video, intrinsics, no true poses."""

import logging
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import islice
from pathlib import Path
from typing import Annotated

import numpy as np
from jaxtyping import Float

from hlp.arrays import Image, Mask, Rgb
from hlp.data import camera_files, images
from hlp.data.frame_paths import FramePaths, VideoFrames, list_images, pair_frames
from hlp.errors import DataError, HlpError, InputError, MissingFileError
from hlp.records import Frame, frame_key, parse_frame_key
from hlp.schemas import require_depths
from hlp.settings import Doc, PositiveOrNone, Settings

_SCENE_ID = 0
_EXAMPLES = 9  # images that are looked at for the unit of depth
_logger = logging.getLogger(__name__)


@dataclass(frozen=True, kw_only=True)
class CameraSettings(Settings):
    """What the files of images do not say about the camera."""

    intrinsics: Annotated[
        str | list[float],
        Doc("file of the colour camera's intrinsics, or [fx,fy,cx,cy] (px); see `read_camera`"),
    ]
    depth_scale: Annotated[
        PositiveOrNone,
        Doc("mm per unit of the depth images; null: the intrinsics file's, else guessed"),
    ] = None
    depth_intrinsics: Annotated[
        str | list[float] | None,
        Doc("the depth camera's intrinsics where depth has another size; null: the same camera"),
    ] = None
    depth_resize: Annotated[
        PositiveOrNone,
        Doc("colour pixels per depth pixel where depth is the same view at another size"),
    ] = None
    undistort: Annotated[
        bool, Doc("undo the distortion that the intrinsics state; false: the images have none")
    ] = True

    def __post_init__(self) -> None:
        """Raise InputError where two keys say the same."""
        super().__post_init__()
        if self.depth_intrinsics is not None and self.depth_resize is not None:
            raise InputError("depth_intrinsics and depth_resize: give one of them")


@dataclass(frozen=True, kw_only=True)
class FrameFiles(CameraSettings):
    """Where a user's frames are, and what their files do not say."""

    rgb: Annotated[str, Doc("a colour image, a folder, a pattern such as 'color_*.png', a video")]
    depth: Annotated[
        str, Doc("its depth image (16-bit PNG, TIFF, EXR, NPY), or a folder or pattern of them")
    ]


class FrameReader:
    """Reads the images of one camera. Constructing it reads no file.

    Depth is brought to the colour image's pixels and distortion is undone, so every image has the
    matrix of the colour camera. The unit of depth, unless stated, is guessed once and logged.
    """

    def __init__(self, settings: CameraSettings) -> None:
        self.settings = settings
        self._videos: dict[Path, VideoFrames] = {}
        self._scale: float | None = None

    @cached_property
    def camera(self) -> camera_files.Camera:
        """The colour camera. Raises what `read_camera` raises."""
        camera = camera_files.read_camera(self.settings.intrinsics)
        if camera.distortion:
            what = "undone" if self.settings.undistort else "taken to be undone already"
            _logger.info("the distortion that the intrinsics state is %s", what)
        return camera if self.settings.undistort else replace(camera, distortion=())

    @cached_property
    def _depth_camera(self) -> camera_files.Camera | None:
        if self.settings.depth_intrinsics is None:
            return None
        return camera_files.read_camera(self.settings.depth_intrinsics, "depth_intrinsics")

    def unit_of(self, example: Path) -> float:
        """Millimetres per unit of the depth images: given, stated, or guessed from an example."""
        if self._scale is None:
            places = (self.settings, self._depth_camera, self.camera)
            stated = (place.depth_scale for place in places if place is not None)
            self._scale = next((scale for scale in stated if scale is not None), None)
        if self._scale is None:
            self._scale, why = images.guess_unit(images.read_raw_depth(example), example)
            _logger.info(why)
        return self._scale

    def read(self, paths: FramePaths) -> tuple[Rgb, Image]:
        """Colour and depth (m). Raises FileNotFoundError, or ValueError for a broken file."""
        if paths.video_index is None:
            rgb = images.read_rgb(paths.color)
        else:
            video = self._videos.get(paths.color) or VideoFrames(paths.color)
            self._videos[paths.color] = video
            rgb = video.read(paths.video_index)
        camera_files.check_size(self.camera, rgb.shape, paths.color, "intrinsics")
        raw = images.read_raw_depth(paths.depth)
        scale = self.unit_of(paths.depth)
        depth = images.depth_metres(raw, scale, paths.depth)
        require_depths(depth, f"{paths.depth} at {scale:g} mm per unit")
        depth = self._registered(depth, rgb.shape[:2], paths)
        return camera_files.undistorted(rgb, self.camera, nearest=False), depth

    def _registered(
        self, depth: Float[np.ndarray, "a b"], shape: tuple[int, int], paths: FramePaths
    ) -> Image:
        """Depth at the pixels of the undistorted colour image."""
        camera = self._depth_camera
        size = (depth.shape[1], depth.shape[0])
        if camera is not None:
            camera_files.check_size(camera, depth.shape, paths.depth, "depth_intrinsics")
            depth = camera_files.undistorted(depth, camera, nearest=True)
        elif self.settings.depth_resize is not None:
            if self.camera.distortion:
                raise InputError("depth_resize: distorted images must have one size")
            scale = 1.0 / self.settings.depth_resize
            camera = camera_files.resized_camera(self.camera.matrix, scale, size)
        elif depth.shape != shape:
            raise DataError(
                f"{paths.color} is {shape[1]}x{shape[0]} but its depth image is {size[0]}x{size[1]}"
                ": give depth_intrinsics=FILE, or depth_resize=NUMBER (colour pixels per depth "
                "pixel) if both show the same view"
            )
        else:
            return camera_files.undistorted(depth, self.camera, nearest=True)
        return camera_files.resampled_depth(depth, camera, self.camera.matrix, shape)


class OwnFrames(FrameReader):
    """Frames without true poses (a `FrameSource`).

    Frames are numbered in the order of their names. The unit of depth is guessed from the first
    that tells one.
    """

    settings: FrameFiles

    @property
    def depth_scale(self) -> float:
        """Millimetres per unit of the depth images: given, stated by a file, or guessed."""
        for paths in islice(self._paths.values(), _EXAMPLES):
            with suppress(HlpError):
                return self.unit_of(paths.depth)
        return self.unit_of(next(iter(self._paths.values())).depth)

    @cached_property
    def _paths(self) -> dict[str, FramePaths]:
        pairs = pair_frames(self.settings.rgb, self.settings.depth)
        return {frame_key(_SCENE_ID, number): pair for number, pair in enumerate(pairs)}

    @property
    def keys(self) -> tuple[str, ...]:
        """Frame keys, numbered in the order of the file names."""
        return tuple(self._paths)

    def __len__(self) -> int:
        return len(self._paths)

    def paths(self, key: str) -> FramePaths:
        """The files of a frame."""
        return self._paths[key]

    def load(self, key: str) -> Frame:
        """Decode one frame. Raises KeyError, FileNotFoundError, or ValueError for a broken file."""
        if key not in self._paths:
            raise KeyError(f"no frame {key!r} in {self.settings.rgb}")
        _ = self.depth_scale
        rgb, depth = self.read(self._paths[key])
        return Frame(*parse_frame_key(key), rgb, depth, self.camera.matrix)


@dataclass(frozen=True)
class SearchMasks:
    """Mask images (an image for all frames, or a folder with their names), or a box.

    `box` is x, y, width and height in pixels. One of both is given.
    """

    masks: str | None = None
    box: tuple[float, float, float, float] | None = None

    def load(self, paths: FramePaths, shape: tuple[int, ...]) -> Mask:
        """Where to look in a frame. Raises MissingFileError, DataError, InputError."""
        mask = np.zeros(shape, dtype=bool)
        if self.box is not None:
            x, y, width, height = (round(value) for value in self.box)
            mask[max(y, 0) : max(y + height, 0), max(x, 0) : max(x + width, 0)] = True
            if not mask.any():
                raise InputError(
                    f"box={list(self.box)} lies outside {paths.color}: x,y,width,height"
                )
            return mask
        found = list_images(str(self.masks), "mask", images.EXTENSIONS)
        one = Path(str(self.masks)).is_file()
        path = next((file for file in found if one or file.stem == paths.name), None)
        if path is None:
            raise MissingFileError(f"mask: {self.masks} has no {paths.name}.png for {paths.color}")
        image = images.read_pixels(path)
        if image.shape[:2] != shape:
            raise DataError(f"{path} is {image.shape[:2]}, the frame {shape}: they must be alike")
        mask = np.asarray(image.reshape(*shape, -1)[..., :3].any(axis=2))
        if not mask.any():
            raise DataError(f"{path} marks no pixel: leave the frame out, or mark where to look")
        return mask
