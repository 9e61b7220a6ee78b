"""Scenes of a BOP data set on disk, in both of BOP's layouts, with the same access to both.

scene-wise   SCENE/rgb/000012.png, SCENE/depth/000012.png, SCENE/scene_camera.json, scene_gt.json, …
image-wise   000006_000012.rgb.png, .depth.png, .camera.json, .gt.json, …; the files of a frame lie
             in the split itself or in a folder of their scene (then the scene's number may be left
             out of the name)

Format: Hodan et al., BOP (ECCV 2018), docs/bop_datasets_format.md and bop_imagewise of the toolkit.
"""

from abc import ABC, abstractmethod
from functools import cache, cached_property
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from jaxtyping import Bool

from hlp.data.images import find_image, read_rgb
from hlp.errors import DataError, MissingFileError
from hlp.schemas import bop
from hlp.schemas.reading import read_as, read_text_json
from hlp.settings import stored_as

T = TypeVar("T")
Mask = Bool[np.ndarray, "h w"]
COLOR, DEPTH = ("rgb", "gray"), ("depth",)
"""Names of kinds of images, the first that is there counts; and of text files:"""
_CAMERA, _TRUTH, _INFO = "camera", "gt", "gt_info"


class Scene(ABC):
    """The files of one scene, read when they are asked for."""

    @property
    @abstractmethod
    def frame_ids(self) -> tuple[int, ...]:
        """Numbers of the frames with a camera or with poses, in order."""

    @property
    @abstractmethod
    def annotated(self) -> bool:
        """Whether the scene states true poses."""

    @abstractmethod
    def image(self, kinds: tuple[str, ...], frame_id: int) -> Path:
        """The image of the first of these kinds that is there, or where it should be."""

    @abstractmethod
    def visible_mask(self, frame_id: int, number: int) -> tuple[Path, Mask] | None:
        """The mask of the pixels that show the annotated instance of this number, and its file."""

    @abstractmethod
    def text_files(self, frame_ids: list[int]) -> list[Path]:
        """The files that state cameras and poses of these frames."""

    @abstractmethod
    def _entry(self, kind: str, frame_id: int) -> tuple[Any, Path]:
        """What a text file states of a frame, empty if nothing; and the file."""

    def camera(self, frame_id: int) -> bop.CameraEntry:
        """The frame's camera. Raises DataError if there is none, or a broken one."""
        entry, path = self._entry(_CAMERA, frame_id)
        if isinstance(entry, dict) and "cam_K" not in entry:
            raise DataError(f"{path} has no cam_K for frame {frame_id}")
        return stored_as(bop.CameraEntry, entry, f"{path}, frame {frame_id}")

    def truth(self, frame_id: int) -> list[bop.TruthEntry]:
        """The annotated instances. Raises MissingFileError if no truth is stated, DataError."""
        return self._listed(_TRUTH, bop.Truths, frame_id)

    def info(self, frame_id: int) -> list[bop.InfoEntry]:
        """Their visible fractions, in the order of `truth`; may be empty. Raises DataError."""
        return self._listed(_INFO, bop.Infos, frame_id)

    def unchecked(self, frame_id: int) -> tuple[Any, Any]:
        """What stands at the place of `truth` and of `info`, whatever it is; empty if nothing."""
        return self._entry(_TRUTH, frame_id)[0], self._entry(_INFO, frame_id)[0]

    def _listed(self, kind: str, schema: type[T], frame_id: int) -> T:
        entry, path = self._entry(kind, frame_id)
        return stored_as(schema, entry, f"{path}, frame {frame_id}")


def list_scenes(split: Path) -> dict[int, Scene]:
    """The scenes of a split by number, in order.

    Raises MissingFileError if there is none, DataError if two folders have one number.
    """
    if not split.is_dir():
        raise MissingFileError(f"no folder {split}: check data.root and data.split")
    scenes: dict[int, Scene] = {}
    for folder in sorted(path for path in split.iterdir() if path.is_dir()):
        if folder.name.isdecimal():
            single = next(folder.glob(f"*.{_CAMERA}.json"), None) is not None
            number = int(folder.name)
            if number in scenes:
                raise DataError(f"{split} has two folders of scene {number}: leave one out")
            scenes[number] = ImagewiseScene(folder, number) if single else ScenewiseScene(folder)
    for path in split.glob(f"*_*.{_CAMERA}.json"):
        name = path.name.partition("_")[0]
        if name.isdecimal():
            scenes.setdefault(int(name), ImagewiseScene(split, int(name)))
    if not scenes:
        raise MissingFileError(
            f"no scene in {split}: neither a folder with a number and scene_camera.json nor "
            f"files SCENE_FRAME.{_CAMERA}.json; check data.root and data.split"
        )
    return dict(sorted(scenes.items()))


class ScenewiseScene(Scene):
    """A scene with one file of cameras and one of poses for all of its frames."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._content = cache(self._read)

    def _file(self, kind: str) -> Path:
        return self._folder / f"scene_{kind}.json"

    def _read(self, kind: str) -> dict[str, Any]:
        path = self._file(kind)
        if kind == _TRUTH and not self.annotated:
            raise _no_poses(path)
        if kind == _INFO and not path.is_file():
            return {}
        return dict(read_as(path, bop.Scene))

    def _entry(self, kind: str, frame_id: int) -> tuple[Any, Path]:
        missing: Any = {} if kind == _CAMERA else []
        return self._content(kind).get(str(frame_id), missing), self._file(kind)

    @property
    def frame_ids(self) -> tuple[int, ...]:
        """Numbers of the frames with a camera or with poses, in order."""
        numbers: set[int] = set()
        for kind in (_CAMERA, _TRUTH) if self.annotated else (_CAMERA,):
            try:
                numbers |= {*bop.whole_ids([*self._content(kind)])}
            except ValueError as error:
                raise DataError(f"{self._file(kind)}: {error}") from error
        return tuple(sorted(numbers))

    @property
    def annotated(self) -> bool:
        """Whether the scene states true poses."""
        return self._file(_TRUTH).is_file()

    def image(self, kinds: tuple[str, ...], frame_id: int) -> Path:
        """The frame's image in the first of these folders that is there."""
        kind = next((kind for kind in kinds if (self._folder / kind).is_dir()), kinds[0])
        return find_image(self._folder / kind, f"{frame_id:06d}")

    def visible_mask(self, frame_id: int, number: int) -> tuple[Path, Mask] | None:
        """The mask in `mask_visib/`, and its file."""
        path = self._folder / "mask_visib" / f"{frame_id:06d}_{number:06d}.png"
        return (path, read_rgb(path)[..., 0] > 0) if path.is_file() else None

    def text_files(self, frame_ids: list[int]) -> list[Path]:
        """The scene's JSON files."""
        paths = [self._file(kind) for kind in (_CAMERA, _TRUTH, _INFO)]
        return [path for path in paths if path.is_file()]


class ImagewiseScene(Scene):
    """A scene in which each frame has its own files for camera and poses."""

    def __init__(self, folder: Path, number: int) -> None:
        self._folder, self._number = folder, number

    @cached_property
    def _stems(self) -> dict[int, str]:
        """File names without their kinds and extensions, by frame."""
        stems = {}
        for ending in (f".{_TRUTH}.json", f".{_CAMERA}.json"):
            for path in sorted(self._folder.glob(f"*{ending}")):
                stem = path.name.removesuffix(ending)
                scene, _, frame = stem.rpartition("_")
                own = not scene or (scene.isdecimal() and int(scene) == self._number)
                if frame.isdecimal() and own:
                    stems[int(frame)] = stem
        return stems

    def _stem(self, frame_id: int) -> str:
        return self._stems.get(frame_id, f"{self._number:06d}_{frame_id:06d}")

    def _file(self, kind: str, frame_id: int) -> Path:
        return self._folder / f"{self._stem(frame_id)}.{kind}.json"

    def _entry(self, kind: str, frame_id: int) -> tuple[Any, Path]:
        path = self._file(kind, frame_id)
        if kind == _INFO and not path.is_file():
            return [], path
        if kind == _TRUTH and not path.is_file():
            raise _no_poses(path)
        return read_text_json(path), path

    def unchecked(self, frame_id: int) -> tuple[Any, Any]:
        """What stands in gt.json and gt_info.json; None also for a broken file."""
        found: list[Any] = []
        for kind in (_TRUTH, _INFO):
            try:
                found.append(self._entry(kind, frame_id)[0])
            except (DataError, MissingFileError):  # `truth` and `info` say so
                found.append(None)
        return found[0], found[1]

    @property
    def frame_ids(self) -> tuple[int, ...]:
        """Numbers of the frames with a camera or with poses, in order."""
        return tuple(sorted(self._stems))

    @property
    def annotated(self) -> bool:
        """Whether the first frame states true poses."""
        return any(self._file(_TRUTH, frame).is_file() for frame in self.frame_ids[:1])

    def image(self, kinds: tuple[str, ...], frame_id: int) -> Path:
        """The frame's image of the first of these kinds that is there."""
        stem = self._stem(frame_id)
        paths = [find_image(self._folder, f"{stem}.{kind}") for kind in kinds]
        return next((path for path in paths if path.is_file()), paths[0])

    def visible_mask(self, frame_id: int, number: int) -> tuple[Path, Mask] | None:
        """The mask in the frame's mask_visib.json, and that file."""
        path = self._file("mask_visib", frame_id)
        if not path.is_file():
            return None
        masks = read_as(path, bop.Scene)
        if str(number) not in masks:
            raise DataError(f"{path} has no mask {number} of run lengths")
        where = f"{path}, mask {number}"
        return path, _from_run_lengths(stored_as(bop.RunLengths, masks[str(number)], where), where)

    def text_files(self, frame_ids: list[int]) -> list[Path]:
        """The JSON files of these frames."""
        kinds = (_CAMERA, _TRUTH, _INFO)
        paths = [self._file(kind, frame_id) for frame_id in frame_ids for kind in kinds]
        return [path for path in paths if path.is_file()]


def _no_poses(path: Path) -> MissingFileError:
    return MissingFileError(
        f"there is no file {path} with true poses to score against (BOP keeps some private): set"
        " data.split to a folder that has them"
    )


def _from_run_lengths(mask: bop.RunLengths, where: str) -> Mask:
    """A mask from COCO's uncompressed run lengths: column by column, starting with False."""
    height, width = mask.size
    if sum(mask.counts) != height * width:
        raise DataError(
            f"{where}: the run lengths add up to {sum(mask.counts)}, they must to {height * width}"
        )
    values = np.arange(len(mask.counts)) % 2 == 1
    return np.repeat(values, mask.counts).reshape(width, height).T.copy()
