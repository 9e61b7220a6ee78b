"""Scenes of a BOP data set on disk, in both of BOP's layouts, with the same access to both.

scene-wise   SCENE/rgb/000012.png, SCENE/depth/000012.png, SCENE/scene_camera.json, scene_gt.json, …
image-wise   000006_000012.rgb.png, .depth.png, .camera.json, .gt.json, …; the files of a frame lie
             in the split itself or in a folder of their scene (then the scene's number may be left
             out of the name)

Format: Hodan et al., BOP (ECCV 2018), docs/bop_datasets_format.md and bop_imagewise of the toolkit.
"""

from functools import cached_property
from pathlib import Path
from typing import Any, Protocol, TypeVar

import numpy as np
from jaxtyping import Bool

from hlp.data.images import EXTENSIONS, find_image, read_rgb
from hlp.errors import DataError, MissingFileError
from hlp.schemas import bop
from hlp.schemas.reading import checked_as, read_as, read_text_json

T = TypeVar("T")
Mask = Bool[np.ndarray, "h w"]
COLOR = ("rgb", "gray")
"""Names of the folders of colour or grey images; the first that is there counts."""
_SCENE_FILES = ("scene_camera.json", "scene_gt.json", "scene_gt_info.json")
_CAMERA = ".camera.json"


class Scene(Protocol):
    """The files of one scene."""

    @property
    def frame_ids(self) -> tuple[int, ...]:
        """Numbers of the frames with a camera or with poses, in order."""
        ...

    @property
    def annotated(self) -> bool:
        """Whether the scene states true poses."""
        ...

    def camera(self, frame_id: int) -> bop.CameraEntry:
        """The frame's camera. Raises DataError if there is none, or a broken one."""
        ...

    def truth(self, frame_id: int) -> list[bop.TruthEntry]:
        """The annotated instances. Raises MissingFileError if no truth is stated, DataError."""
        ...

    def info(self, frame_id: int) -> list[bop.InfoEntry]:
        """Their visible fractions, in the order of `truth`; may be empty. Raises DataError."""
        ...

    def unchecked(self, frame_id: int) -> tuple[Any, Any]:
        """What stands at the place of `truth` and of `info`, whatever it is; None if nothing."""
        ...

    def image(self, kinds: tuple[str, ...], frame_id: int) -> Path:
        """The first image that is there of these kinds. Raises MissingFileError."""
        ...

    def visible_mask(self, frame_id: int, number: int) -> tuple[Path, Mask] | None:
        """The mask of the pixels that show the annotated instance of this number, and its file."""
        ...

    def text_files(self, frame_ids: list[int]) -> list[Path]:
        """The files that state cameras and poses of these frames."""
        ...


def list_scenes(split: Path) -> dict[int, Scene]:
    """The scenes of a split by number, in order.

    Raises MissingFileError if there is none, DataError if two folders have one number.
    """
    if not split.is_dir():
        raise MissingFileError(f"no folder {split}: check data.root and data.split")
    scenes: dict[int, Scene] = {}
    for folder in sorted(each for each in split.iterdir() if each.is_dir()):
        if folder.name.isdecimal():
            single = next(folder.glob(f"*{_CAMERA}"), None) is not None
            number = int(folder.name)
            if number in scenes:
                raise DataError(f"{split} has two folders of scene {number}: leave one out")
            scenes[number] = ImagewiseScene(folder, number) if single else ScenewiseScene(folder)
    for path in split.glob(f"*_*{_CAMERA}"):
        name = path.name.partition("_")[0]
        if name.isdecimal():
            scenes.setdefault(int(name), ImagewiseScene(split, int(name)))
    if not scenes:
        raise MissingFileError(
            f"no scene in {split}: neither a folder with a number and scene_camera.json nor "
            f"files SCENE_FRAME{_CAMERA}; check data.root and data.split"
        )
    return dict(sorted(scenes.items()))


class ScenewiseScene:
    """A scene with one file of cameras and one of poses for all of its frames."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._camera_file, self._truth_file, self._info_file = (
            folder / name for name in _SCENE_FILES
        )

    @cached_property
    def _cameras(self) -> dict[str, Any]:
        return dict(read_as(self._camera_file, bop.Scene))

    @cached_property
    def _truths(self) -> dict[str, Any]:
        if not self.annotated:
            raise _no_poses(self._truth_file)
        return dict(read_as(self._truth_file, bop.Scene))

    @cached_property
    def _infos(self) -> dict[str, Any]:
        there = self._info_file.is_file()
        return dict(read_as(self._info_file, bop.Scene)) if there else {}

    @property
    def frame_ids(self) -> tuple[int, ...]:
        """Numbers of the frames with a camera or with poses, in order."""
        numbers: set[int] = set()
        files = {self._camera_file: self._cameras}
        if self.annotated:
            files[self._truth_file] = self._truths
        for path, entries in files.items():
            try:
                numbers |= {*bop.whole_ids([*entries])}
            except ValueError as error:
                raise DataError(f"{path}: {error}") from error
        return tuple(sorted(numbers))

    @property
    def annotated(self) -> bool:
        """Whether the scene states true poses."""
        return self._truth_file.is_file()

    def camera(self, frame_id: int) -> bop.CameraEntry:
        """The frame's entry in scene_camera.json. Raises DataError if there is none."""
        path, entry = self._camera_file, self._cameras.get(str(frame_id))
        if entry is None or (isinstance(entry, dict) and "cam_K" not in entry):
            raise DataError(f"{path} has no cam_K for frame {frame_id}")
        return _checked(entry, bop.CameraEntry, path, frame_id)

    def truth(self, frame_id: int) -> list[bop.TruthEntry]:
        """The frame's entries in scene_gt.json."""
        entries = self._truths.get(str(frame_id), [])
        return list(_checked(entries, bop.Truths, self._truth_file, frame_id))

    def info(self, frame_id: int) -> list[bop.InfoEntry]:
        """The frame's entries in scene_gt_info.json, if there is one."""
        entries = self._infos.get(str(frame_id), [])
        return list(_checked(entries, bop.Infos, self._info_file, frame_id))

    def unchecked(self, frame_id: int) -> tuple[Any, Any]:
        """What stands in scene_gt.json and scene_gt_info.json."""
        return self._truths.get(str(frame_id)), self._infos.get(str(frame_id))

    def image(self, kinds: tuple[str, ...], frame_id: int) -> Path:
        """The frame's image in the first of these folders that is there."""
        kind = next((each for each in kinds if (self._folder / each).is_dir()), kinds[0])
        return find_image(self._folder / kind, f"{frame_id:06d}")

    def visible_mask(self, frame_id: int, number: int) -> tuple[Path, Mask] | None:
        """The mask in `mask_visib/`, and its file."""
        path = self._folder / "mask_visib" / f"{frame_id:06d}_{number:06d}.png"
        return (path, read_rgb(path)[..., 0] > 0) if path.is_file() else None

    def text_files(self, frame_ids: list[int]) -> list[Path]:
        """The scene's JSON files."""
        return [path for name in _SCENE_FILES if (path := self._folder / name).is_file()]


class ImagewiseScene:
    """A scene in which each frame has its own files for camera and poses."""

    def __init__(self, folder: Path, number: int) -> None:
        self._folder, self._number = folder, number

    @cached_property
    def _stems(self) -> dict[int, str]:
        """File names without their kinds and extensions, by frame."""
        stems = {}
        for ending in (".gt.json", _CAMERA):
            for path in sorted(self._folder.glob(f"*{ending}")):
                stem = path.name.removesuffix(ending)
                scene, _, frame = stem.rpartition("_")
                if frame.isdecimal() and (not scene or _is(scene, self._number)):
                    stems[int(frame)] = stem
        return stems

    def _path(self, frame_id: int, ending: str) -> Path:
        stem = self._stems.get(frame_id, f"{self._number:06d}_{frame_id:06d}")
        return self._folder / f"{stem}{ending}"

    @property
    def frame_ids(self) -> tuple[int, ...]:
        """Numbers of the frames with a camera or with poses, in order."""
        return tuple(sorted(self._stems))

    @property
    def annotated(self) -> bool:
        """Whether the first frame states true poses."""
        return any(self._path(frame, ".gt.json").is_file() for frame in self.frame_ids[:1])

    def camera(self, frame_id: int) -> bop.CameraEntry:
        """The frame's camera.json. Raises DataError if it has no `cam_K`."""
        path = self._path(frame_id, _CAMERA)
        entry = read_text_json(path)
        if isinstance(entry, dict) and "cam_K" not in entry:
            raise DataError(f"{path} has no cam_K for frame {frame_id}")
        return _checked(entry, bop.CameraEntry, path, frame_id)

    def truth(self, frame_id: int) -> list[bop.TruthEntry]:
        """The entries of the frame's gt.json."""
        path = self._path(frame_id, ".gt.json")
        if not path.is_file():
            raise _no_poses(path)
        return list(read_as(path, bop.Truths))

    def info(self, frame_id: int) -> list[bop.InfoEntry]:
        """The entries of the frame's gt_info.json, if there is one."""
        path = self._path(frame_id, ".gt_info.json")
        return list(read_as(path, bop.Infos)) if path.is_file() else []

    def unchecked(self, frame_id: int) -> tuple[Any, Any]:
        """What stands in gt.json and gt_info.json; None also for a broken file."""
        found: list[Any] = []
        for ending in (".gt.json", ".gt_info.json"):
            path = self._path(frame_id, ending)
            try:
                found.append(read_text_json(path) if path.is_file() else None)
            except DataError:  # `truth` and `info` say so
                found.append(None)
        return found[0], found[1]

    def image(self, kinds: tuple[str, ...], frame_id: int) -> Path:
        """The frame's image of the first of these kinds that is there."""
        for kind in kinds:
            for extension in EXTENSIONS:
                if (path := self._path(frame_id, f".{kind}{extension}")).is_file():
                    return path
        raise MissingFileError(
            f"no image {self._path(frame_id, f'.{kinds[0]}.png')} (nor .jpg): is the data set"
            " complete?"
        )

    def visible_mask(self, frame_id: int, number: int) -> tuple[Path, Mask] | None:
        """The mask in the frame's mask_visib.json, and that file."""
        path = self._path(frame_id, ".mask_visib.json")
        if not path.is_file():
            return None
        masks = read_as(path, bop.Scene)
        if str(number) not in masks:
            raise DataError(f"{path} has no mask {number} of run lengths")
        where = f"{path}, mask {number}"
        return path, _from_run_lengths(checked_as(masks[str(number)], bop.RunLengths, where), where)

    def text_files(self, frame_ids: list[int]) -> list[Path]:
        """The JSON files of these frames."""
        endings = (_CAMERA, ".gt.json", ".gt_info.json")
        paths = (self._path(frame, ending) for frame in frame_ids for ending in endings)
        return [path for path in paths if path.is_file()]


def _is(text: str, number: int) -> bool:
    return text.isdecimal() and int(text) == number


def _no_poses(path: Path) -> MissingFileError:
    return MissingFileError(
        f"there is no file {path} with true poses to score against (BOP keeps some private): set"
        " data.split to a folder that has them"
    )


def _checked(entry: Any, kind: type[T], path: Path, frame_id: int) -> T:
    return checked_as(entry, kind, f"{path}, frame {frame_id}")


def _from_run_lengths(mask: bop.RunLengths, where: str) -> Mask:
    """A mask from COCO's uncompressed run lengths: column by column, starting with False."""
    height, width = mask.size
    if sum(mask.counts) != height * width:
        raise DataError(
            f"{where}: the run lengths add up to {sum(mask.counts)}, they must to {height * width}"
        )
    values = np.arange(len(mask.counts)) % 2 == 1
    return np.repeat(values, mask.counts).reshape(width, height).T.copy()
