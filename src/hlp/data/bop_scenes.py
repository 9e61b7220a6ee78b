"""Scenes of a BOP data set on disk, in both of BOP's layouts, with the same access to both.

scene-wise   SCENE/rgb/000012.png, SCENE/depth/000012.png, SCENE/scene_camera.json, scene_gt.json, …
image-wise   000006_000012.rgb.png, .depth.png, .camera.json, .gt.json, …; the files of a frame lie
             in the split itself or in a folder of their scene (then the scene's number may be left
             out of the name)

Format: Hodan et al., BOP (ECCV 2018), docs/bop_datasets_format.md and bop_imagewise of the toolkit.
"""

from functools import cache, cached_property
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Bool

from hlp import schemas
from hlp.data.images import find_image, read_rgb
from hlp.errors import DataError, MissingFileError
from hlp.files import read_json
from hlp.settings import read_as, stored_as

Mask = Bool[np.ndarray, "h w"]
COLOR, DEPTH = ("rgb", "gray"), ("depth",)
"""Names of kinds of images, the first that is there counts; and of text files:"""
_CAMERA, _TRUTH, _INFO = "camera", "gt", "gt_info"


class Scene:
    """The files of one scene, read when they are asked for. With a `number` it is image-wise."""

    def __init__(self, folder: Path, number: int | None = None) -> None:
        self._folder, self._number = folder, number
        self._entries = cache(lambda path: read_as(path, schemas.Scene))

    @property
    def frame_ids(self) -> tuple[int, ...]:
        """Numbers of the frames with a camera or with poses, in order."""
        if self._number is not None:
            return tuple(sorted(self._stems))
        numbers: set[int] = set()
        for kind in (_CAMERA, _TRUTH) if self.annotated else (_CAMERA,):
            path = self._file(kind, 0)
            try:
                numbers |= {*schemas.whole_ids([*self._entries(path)])}
            except ValueError as error:
                raise DataError(f"{path}: {error}") from error
        return tuple(sorted(numbers))

    @property
    def annotated(self) -> bool:
        """Whether the scene, or its first frame, states true poses."""
        frames = (0,) if self._number is None else self.frame_ids[:1]
        return any(self._file(_TRUTH, frame).is_file() for frame in frames)

    def camera(self, frame_id: int) -> schemas.CameraEntry:
        """The frame's camera. Raises DataError if there is none, or a broken one."""
        entry, path = self._entry(_CAMERA, frame_id)
        if isinstance(entry, dict) and "cam_K" not in entry:
            raise DataError(f"{path} has no cam_K for frame {frame_id}")
        return stored_as(schemas.CameraEntry, entry, f"{path}, frame {frame_id}")

    def truth(self, frame_id: int) -> list[schemas.TruthEntry]:
        """The annotated instances. Raises MissingFileError if no truth is stated, DataError."""
        entry, path = self._entry(_TRUTH, frame_id)
        return stored_as(schemas.Truths, entry, f"{path}, frame {frame_id}")

    def info(self, frame_id: int) -> list[schemas.InfoEntry]:
        """Their visible fractions, in the order of `truth`; may be empty. Raises DataError."""
        entry, path = self._entry(_INFO, frame_id)
        return stored_as(schemas.Infos, entry, f"{path}, frame {frame_id}")

    def unchecked(self, frame_id: int) -> tuple[Any, Any]:
        """What stands at the place of `truth` and of `info`, whatever it is; empty if nothing.

        None for a broken file of this frame alone, of which `truth` and `info` complain.
        """
        found: list[Any] = []
        for kind in (_TRUTH, _INFO):
            try:
                found.append(self._entry(kind, frame_id)[0])
            except (DataError, MissingFileError):
                if self._number is None:
                    raise
                found.append(None)
        return found[0], found[1]

    def image(self, kinds: tuple[str, ...], frame_id: int) -> Path:
        """The image of the first of these kinds that is there, or where it should be."""
        if self._number is None:
            there = [kind for kind in kinds if (self._folder / kind).is_dir()] or kinds
            return find_image(self._folder / there[0], f"{frame_id:06d}")
        stem = self._stem(frame_id)
        paths = [find_image(self._folder, f"{stem}.{kind}") for kind in kinds]
        return next((path for path in paths if path.is_file()), paths[0])

    def visible_mask(self, frame_id: int, number: int) -> tuple[Path, Mask] | None:
        """The mask of the pixels that show the annotated instance of this number, and its file."""
        if self._number is None:
            path = self._folder / "mask_visib" / f"{frame_id:06d}_{number:06d}.png"
            return (path, read_rgb(path)[..., 0] > 0) if path.is_file() else None
        path = self._file("mask_visib", frame_id)
        if not path.is_file():
            return None
        masks, where = read_as(path, schemas.Scene), f"{path}, mask {number}"
        if str(number) not in masks:
            raise DataError(f"{path} has no mask {number} of run lengths")
        lengths = stored_as(schemas.RunLengths, masks[str(number)], where)
        return path, _from_run_lengths(lengths, where)

    def text_files(self, frame_ids: list[int]) -> list[Path]:
        """The files that state cameras and poses of these frames."""
        kinds = (_CAMERA, _TRUTH, _INFO)
        paths = [self._file(kind, frame_id) for frame_id in frame_ids for kind in kinds]
        return [path for path in dict.fromkeys(paths) if path.is_file()]

    def _entry(self, kind: str, frame_id: int) -> tuple[Any, Path]:
        """What a text file states of a frame, empty if nothing; and the file."""
        path = self._file(kind, frame_id)
        if kind != _CAMERA and not path.is_file():
            if kind == _TRUTH:
                raise _no_poses(path)
            return [], path
        if self._number is not None:
            return read_json(path), path
        nothing: Any = {} if kind == _CAMERA else []
        return self._entries(path).get(str(frame_id), nothing), path

    def _file(self, kind: str, frame_id: int) -> Path:
        if self._number is None:
            return self._folder / f"scene_{kind}.json"
        return self._folder / f"{self._stem(frame_id)}.{kind}.json"

    def _stem(self, frame_id: int) -> str:
        return self._stems.get(frame_id, f"{self._number:06d}_{frame_id:06d}")

    @cached_property
    def _stems(self) -> dict[int, str]:
        """File names of an image-wise scene without their kinds and extensions, by frame."""
        stems = {}
        for ending in (f".{_TRUTH}.json", f".{_CAMERA}.json"):
            for path in sorted(self._folder.glob(f"*{ending}")):
                stem = path.name.removesuffix(ending)
                scene, _, frame = stem.rpartition("_")
                own = not scene or (scene.isdecimal() and int(scene) == self._number)
                if frame.isdecimal() and own:
                    stems[int(frame)] = stem
        return stems


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
            scenes[number] = Scene(folder, number if single else None)
    for path in split.glob(f"*_*.{_CAMERA}.json"):
        name = path.name.partition("_")[0]
        if name.isdecimal():
            scenes.setdefault(int(name), Scene(split, int(name)))
    if not scenes:
        raise MissingFileError(
            f"no scene in {split}: neither a folder with a number and scene_camera.json nor "
            f"files SCENE_FRAME.{_CAMERA}.json; check data.root and data.split"
        )
    return dict(sorted(scenes.items()))


def _no_poses(path: Path) -> MissingFileError:
    return MissingFileError(
        f"there is no file {path} with true poses to score against (BOP keeps some private): set"
        " data.split to a folder that has them"
    )


def _from_run_lengths(mask: schemas.RunLengths, where: str) -> Mask:
    """A mask from COCO's uncompressed run lengths: column by column, starting with False."""
    height, width = mask.size
    if sum(mask.counts) != height * width:
        raise DataError(
            f"{where}: the run lengths add up to {sum(mask.counts)}, they must to {height * width}"
        )
    values = np.arange(len(mask.counts)) % 2 == 1
    return np.repeat(values, mask.counts).reshape(width, height).T.copy()
