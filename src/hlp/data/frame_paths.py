"""Which depth image belongs to which colour image: files, folders, file patterns, a video."""

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

from hlp.data.images import DEPTH_EXTENSIONS, EXTENSIONS
from hlp.errors import InputError, MissingFileError

VIDEO_EXTENSIONS = (".mp4", ".avi", ".mkv", ".mov", ".webm", ".m4v")
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


def is_pattern(path: str | Path) -> bool:
    """Whether a path is a file pattern such as `frames/color_*.png`, and no file itself."""
    return bool(_WILD.search(Path(path).name)) and not Path(path).exists()


def list_images(given: str, key: str, extensions: tuple[str, ...]) -> list[Path]:
    """Files that a path, folder or pattern names, sorted so that 2 comes before 10.

    Raises MissingFileError naming `key` if there are none.
    """
    path = Path(given)
    if is_pattern(path):
        found = [each for each in path.parent.glob(path.name) if each.is_file()]
        problem = f"{key}: no file is like {path} (set {key}=PATTERN, quoted, with a *)"
    elif path.is_dir():
        found = [each for each in path.iterdir() if each.suffix.lower() in extensions]
        found = [each for each in found if each.is_file() and not each.name.startswith(".")]
        problem = f"{key}: no image in {path}"
    elif path.is_file():
        return [path]
    else:
        raise MissingFileError(
            f"{key} is no image and no folder: {path} (set {key}=IMAGE, {key}=FOLDER or a pattern)"
        )
    if not found:
        raise MissingFileError(problem)
    return sorted(found, key=lambda each: natural(each.name))


def natural(name: str) -> list[tuple[int, str]]:
    """A key that sorts names with their numbers as numbers."""
    return [(int(part), "") if part.isdecimal() else (-1, part) for part in _parts(name)]


def pair_frames(rgb: str, depth: str, count_frames: Callable[[Path], int]) -> list[FramePaths]:
    """Colour and depth files of every frame, in order.

    Two files are one frame. Of folders and patterns, files are paired by their names; if no name
    is in both, by the last number in them: color_1.png and depth_1.png. A video's frames are paired
    with the sorted depth images, which must be as many as `count_frames` says. Raises
    MissingFileError and InputError naming what has no partner.
    """
    images = list_images(rgb, "rgb", EXTENSIONS)
    depths = list_images(depth, "depth", DEPTH_EXTENSIONS)
    one_rgb, one_depth = (Path(each).is_file() for each in (rgb, depth))
    if one_rgb and images[0].suffix.lower() in VIDEO_EXTENSIONS:
        return _of_video(images[0], depths, depth, count_frames)
    if one_rgb and one_depth:
        return [FramePaths(images[0], depths[0])]
    if one_depth:
        raise InputError(f"depth is one image and rgb has {len(images)}: give two of a kind")
    _check_names(images, "rgb")
    by_stem = {each.stem: each for each in depths}
    stems = set(by_stem) & {each.stem for each in images}
    if stems or one_rgb:
        keys: Callable[[Path], str] = _stem
    else:
        keys = _number
        by_stem = _numbered(depths, "depth")
        _numbered(images, "rgb")
    return [FramePaths(each, _partner(each, keys(each), by_stem, depth)) for each in images]


def pairs_so_far(rgb: str, depth: str) -> list[FramePaths]:
    """The frames of two folders or patterns that are being filled, in order of their names.

    Images are paired as by `pair_frames`; those without a partner are left out: it may come yet.
    """
    images, depths = _listed(rgb, "rgb", EXTENSIONS), _listed(depth, "depth", DEPTH_EXTENSIONS)
    keys: Callable[[Path], str] = _stem
    partners = {keys(each): each for each in depths}
    if not any(keys(each) in partners for each in images):
        keys = _number
        partners = {keys(each): each for each in depths if keys(each)}
    return [FramePaths(each, partners[keys(each)]) for each in images if keys(each) in partners]


def _listed(given: str, key: str, extensions: tuple[str, ...]) -> list[Path]:
    try:
        return list_images(given, key, extensions)
    except MissingFileError:
        return []


def _of_video(
    video: Path, depths: list[Path], given: str, count_frames: Callable[[Path], int]
) -> list[FramePaths]:
    count = count_frames(video)
    if count != len(depths):
        raise InputError(
            f"rgb, {video}, has {count} frames, depth, {given}, has {len(depths)} images: "
            "there must be one for each frame"
        )
    return [FramePaths(video, path, index) for index, path in enumerate(depths)]


def _check_names(images: list[Path], key: str) -> None:
    for first, second in pairwise(sorted(images, key=_stem)):
        if first.stem == second.stem:
            raise InputError(f"{key}: {first} and {second} have one name: remove one of them")


def _partner(image: Path, key: str, depths: Mapping[str, Path], given: str) -> Path:
    if key not in depths:
        name = f"{image.stem}.png" if image.stem == key else f"number {key}"
        raise MissingFileError(f"depth: {given} has no {name} for the rgb image {image}")
    return depths[key]


def _numbered(files: list[Path], key: str) -> dict[str, Path]:
    found: dict[str, Path] = {}
    for each in files:
        number = _number(each)
        if not number or number in found:
            raise InputError(
                f"{key}: {each.name} and the other images cannot be paired by their names: call "
                "the two images of a frame alike, or color_1.png and depth_1.png"
            )
        found[number] = each
    return found


def _stem(path: Path) -> str:
    return path.stem


def _number(path: Path) -> str:
    """The last number in a file's name, without leading zeros; empty if there is none."""
    digits = re.findall(r"\d+", path.stem)
    return str(int(digits[-1])) if digits else ""


def _parts(name: str) -> list[str]:
    return re.findall(r"\d+|\D+", name)


CAMERA_FILES = ("cam_K.txt", "camera.json", "intrinsics.json", "scene_camera.json")
"""Names of the file with the intrinsics: YCBInEOAT's, ours, RealSense's or Open3D's, BOP's."""
_NAMES = {"rgb": ("rgb", "color"), "depth": ("depth",), "intrinsics": CAMERA_FILES}


def with_frames(given: Mapping[str, str]) -> dict[str, str]:
    """Arguments in which `frames=FOLDER` is replaced by what is in the folder.

    What is given besides, such as the intrinsics, is taken in place of the folder's. Raises
    MissingFileError for what is not there, and InputError if `rgb` is given too.
    """
    if "frames" not in given:
        return dict(given)
    if "rgb" in given:
        raise InputError("frames and rgb: give one of them")
    root = Path(given["frames"]).expanduser()
    if not root.is_dir():
        raise MissingFileError(f"frames is no folder: {root} (set frames=FOLDER)")
    rest = {key: value for key, value in given.items() if key != "frames"}
    found = {key: _first(root, names, key) for key, names in _NAMES.items() if key not in rest}
    return found | rest


def _first(root: Path, names: tuple[str, ...], key: str) -> str:
    for name in names:
        if (root / name).exists():
            return str(root / name)
    raise MissingFileError(f"{root} has no {' or '.join(names)}: give {key}=… too")
