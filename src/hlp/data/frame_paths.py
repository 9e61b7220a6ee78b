"""A user's frames on disk: which depth image belongs to which colour image; frames of videos."""

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from itertools import pairwise
from operator import attrgetter
from pathlib import Path

import cv2
import numpy as np

from hlp.arrays import Rgb
from hlp.data.images import DEPTH_EXTENSIONS, EXTENSIONS
from hlp.errors import DataError, InputError, MissingFileError
from hlp.files import EXAMPLE, expanded, shipped_folder

VIDEO_EXTENSIONS = (".mp4", ".avi", ".mkv", ".mov", ".webm", ".m4v")
CAMERA_FILES = ("cam_K.txt", "camera.json", "intrinsics.json", "scene_camera.json")
"""Names of the file with the intrinsics: YCBInEOAT's, ours, RealSense's or Open3D's, BOP's."""
_NAMES = {"rgb": ("rgb", "color"), "depth": ("depth",), "intrinsics": CAMERA_FILES}
_stem: Callable[[Path], str] = attrgetter("stem")
_WILD = re.compile(r"[*?\[]")


@dataclass(frozen=True)
class FramePaths:
    """One frame's files. `video_index` counts the frames of a video, None for an image."""

    color: Path
    depth: Path
    video_index: int | None = None

    @property
    def name(self) -> str:
        """What the frame is called in results and pictures, without an extension."""
        if self.video_index is None:
            return self.color.stem
        return f"{self.color.stem}_{self.video_index:06d}"


def with_frames(given: Mapping[str, str]) -> dict[str, str]:
    """Arguments in which `frames=FOLDER` is replaced by what is in the folder.

    What is given besides, such as the intrinsics, is taken in place of the folder's. The learnt
    example without any frames is looked for in its own. Raises MissingFileError for what is not
    there, and InputError if `rgb` is given too.
    """
    if given.get("learnt") == EXAMPLE and not {"frames", *_NAMES} & given.keys():
        given = {**given, "frames": str(shipped_folder(EXAMPLE) / "frames")}
    if "frames" not in given:
        return dict(given)
    if "rgb" in given:
        raise InputError("frames and rgb: give one of them")
    root = expanded(given["frames"])
    if not root.is_dir():
        raise MissingFileError(f"frames is not a folder: {root} (set frames=FOLDER)")
    found = {key: value for key, value in given.items() if key != "frames"}
    for key, names in _NAMES.items():
        if key not in found:
            there = next((name for name in names if (root / name).exists()), None)
            if there is None:
                raise MissingFileError(f"{root} has no {' or '.join(names)}: give {key}=… too")
            found[key] = str(root / there)
    return found


def is_pattern(path: str | Path) -> bool:
    """Whether a path is a file pattern such as `frames/color_*.png`, and no file itself."""
    return bool(_WILD.search(Path(path).name)) and not Path(path).exists()


def list_images(given: str, key: str, extensions: tuple[str, ...]) -> list[Path]:
    """Files that a path, folder or pattern names, sorted so that 2 comes before 10.

    Raises MissingFileError naming `key` if there are none.
    """
    path = Path(given)
    if is_pattern(path):
        found = [file for file in path.parent.glob(path.name) if not file.is_dir()]
        problem = f"{key}: no file is like {path} (set {key}=PATTERN, quoted, with a *)"
    elif path.is_dir():
        found = [file for file in path.iterdir() if file.suffix.lower() in extensions]
        found = [file for file in found if not (file.is_dir() or file.name.startswith("."))]
        problem = f"{key}: no image in {path}"
    elif path.is_file():
        return [path]
    else:
        raise MissingFileError(
            f"{key} is neither an image nor a folder: {path} (set {key}=IMAGE, FOLDER or a pattern)"
        )
    if not found:
        raise MissingFileError(problem)
    return sorted(found, key=lambda file: natural(file.name))


def natural(name: str) -> list[tuple[int, str]]:
    """A key that sorts names with their numbers as numbers."""
    parts = re.findall(r"\d+|\D+", name)
    return [(int(part), "") if part.isdecimal() else (-1, part) for part in parts]


def pair_frames(rgb: str, depth: str) -> list[FramePaths]:
    """Colour and depth files of every frame, in order.

    Two files are one frame. Of folders and patterns, files are paired by their names; if no name
    is in both, by the last number in them: color_1.png and depth_1.png. A video's frames are paired
    with the sorted depth images, which must be as many. Raises MissingFileError and InputError
    naming what has no partner.
    """
    images = list_images(rgb, "rgb", EXTENSIONS)
    depths = list_images(depth, "depth", DEPTH_EXTENSIONS)
    one_rgb, one_depth = Path(rgb).is_file(), Path(depth).is_file()
    if one_rgb and images[0].suffix.lower() in VIDEO_EXTENSIONS:
        if (count := count_video_frames(images[0])) != len(depths):
            raise InputError(
                f"rgb, {images[0]}, has {count} frames, depth, {depth}, has {len(depths)} images: "
                "there must be one for each frame"
            )
        return [FramePaths(images[0], path, index) for index, path in enumerate(depths)]
    if one_rgb and one_depth:
        return [FramePaths(images[0], depths[0])]
    if one_depth:
        raise InputError(f"depth is one image and rgb has {len(images)}: give two of a kind")
    for first, second in pairwise(sorted(images, key=_stem)):
        if first.stem == second.stem:
            raise InputError(f"rgb: {first} and {second} have one name: remove one of them")
    key = _stem
    if not one_rgb and {*map(_stem, images)}.isdisjoint(map(_stem, depths)):
        key = _number
        _require_numbers(images, "rgb")
        _require_numbers(depths, "depth")
    partners = {key(path): path for path in depths}
    for image in images:
        if key(image) not in partners:
            name = f"{image.stem}.png" if key is _stem else f"number {key(image)}"
            raise MissingFileError(f"depth: {depth} has no {name} for the rgb image {image}")
    return [FramePaths(image, partners[key(image)]) for image in images]


def pairs_so_far(rgb: str, depth: str) -> list[FramePaths]:
    """The frames of two folders or patterns that are being filled, in order of their names.

    Images are paired as by `pair_frames`; those without a partner are left out: it may come yet.
    """
    try:
        images = list_images(rgb, "rgb", EXTENSIONS)
        depths = list_images(depth, "depth", DEPTH_EXTENSIONS)
    except MissingFileError:
        return []
    key = _stem
    if {*map(_stem, images)}.isdisjoint(map(_stem, depths)):
        key = _number
    partners = {key(path): path for path in depths if key(path)}
    return [FramePaths(image, partners[key(image)]) for image in images if key(image) in partners]


def _require_numbers(files: list[Path], key: str) -> None:
    """Raise InputError unless the names have numbers, all different."""
    seen = set[str]()
    for file in files:
        number = _number(file)
        if not number or number in seen:
            raise InputError(
                f"{key}: {file.name} and the other images cannot be paired by their names: call "
                "the two images of a frame alike, or color_1.png and depth_1.png"
            )
        seen.add(number)


def _number(path: Path) -> str:
    """The last number in a file's name, without leading zeros; empty if there is none."""
    digits = re.findall(r"\d+", path.stem)
    return str(int(digits[-1])) if digits else ""


class VideoFrames:
    """Colour images of a video by index. Reading in order is fast; going back starts anew.

    Not for several threads at once. Seeking is avoided: with many codecs it is some frames off.
    """

    def __init__(self, path: Path) -> None:
        self._path, self._capture, self._next = path, _opened(path), 0

    def read(self, index: int) -> Rgb:
        """The frame of an index, as RGB. Raises DataError where the video has no such frame."""
        if index < self._next:
            self._capture, self._next = _opened(self._path), 0
        while self._next < index and self._capture.grab():
            self._next += 1
        good, image = self._capture.read()
        if self._next != index or not good:
            self._capture, self._next = _opened(self._path), 0
            raise DataError(f"{self._path}: frame {index} cannot be read: the video is cut off")
        self._next += 1
        return np.ascontiguousarray(image[..., ::-1])


def count_video_frames(path: Path) -> int:
    """Number of frames, counted: what files state is often wrong. Raises DataError if it is none.

    Nothing is decoded into pictures, so that a minute of video takes about a second.
    """
    capture, count = _opened(path), 0
    while capture.grab():
        count += 1
    return count


def _opened(path: Path) -> cv2.VideoCapture:
    capture = cv2.VideoCapture(str(path))
    if not capture.isOpened():
        raise DataError(f"{path} is truncated or no video that OpenCV can read")
    return capture
