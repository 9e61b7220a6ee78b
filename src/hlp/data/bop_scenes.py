"""Scenes of a BOP data set on disk, in both of BOP's layouts, with the same access to both.

scene-wise   SCENE/rgb/000012.png, SCENE/depth/000012.png, SCENE/scene_camera.json, scene_gt.json, …
image-wise   000006_000012.rgb.png, .depth.png, .camera.json, .gt.json, …; the files of a frame lie
             in the split itself or in a folder of their scene (then the scene's number may be left
             out of the name)

Format: Hodan et al., BOP (ECCV 2018), docs/bop_datasets_format.md and bop_imagewise of the toolkit.
"""

from functools import cached_property
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from jaxtyping import Bool

from hlp.data.images import EXTENSIONS, find_image, read_rgb
from hlp.errors import DataError, MissingFileError
from hlp.files import read_json

Mask = Bool[np.ndarray, "h w"]
COLOR = ("rgb", "gray")
"""Names of the folders of colour or grey images; the first that is there counts."""
_SCENE_FILES = ("scene_camera.json", "scene_gt.json", "scene_gt_info.json")
_CAMERA = ".camera.json"


class Scene(Protocol):
    """The files of one scene."""

    @property
    def frame_ids(self) -> tuple[int, ...]:
        """Numbers of the frames with a camera, in order."""
        ...

    @property
    def annotated(self) -> bool:
        """Whether the scene states true poses."""
        ...

    def camera(self, frame_id: int) -> dict[str, Any]:
        """The frame's entry with `cam_K`. Raises DataError if there is none."""
        ...

    def truth(self, frame_id: int) -> list[Any]:
        """Entries of the annotated instances. Raises MissingFileError if no truth is stated."""
        ...

    def info(self, frame_id: int) -> list[Any]:
        """Entries with boxes and visible fractions, in the order of `truth`; may be empty."""
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
    """The scenes of a split by number, in order. Raises MissingFileError if there is none."""
    if not split.is_dir():
        raise MissingFileError(f"no folder {split}: check data.root and data.split")
    scenes: dict[int, Scene] = {}
    for folder in sorted(each for each in split.iterdir() if each.is_dir()):
        if folder.name.isdecimal():
            single = next(folder.glob(f"*{_CAMERA}"), None) is not None
            number = int(folder.name)
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

    @cached_property
    def _cameras(self) -> dict[str, Any]:
        return dict(read_json(self._folder / _SCENE_FILES[0]))

    @cached_property
    def _truths(self) -> dict[str, Any]:
        if not self.annotated:
            raise _no_poses(self._folder / _SCENE_FILES[1])
        return dict(read_json(self._folder / _SCENE_FILES[1]))

    @cached_property
    def _infos(self) -> dict[str, Any]:
        path = self._folder / _SCENE_FILES[2]
        return dict(read_json(path)) if path.is_file() else {}

    @property
    def frame_ids(self) -> tuple[int, ...]:
        """Numbers of the frames with a camera, in order."""
        return tuple(sorted(map(int, self._cameras)))

    @property
    def annotated(self) -> bool:
        """Whether the scene states true poses."""
        return (self._folder / _SCENE_FILES[1]).is_file()

    def camera(self, frame_id: int) -> dict[str, Any]:
        """The frame's entry in scene_camera.json. Raises DataError if there is none."""
        entry: dict[str, Any] = self._cameras.get(str(frame_id), {})
        if "cam_K" not in entry:
            path = self._folder / _SCENE_FILES[0]
            raise DataError(f"{path} has no cam_K for frame {frame_id}")
        return entry

    def truth(self, frame_id: int) -> list[Any]:
        """The frame's entries in scene_gt.json."""
        return list(self._truths.get(str(frame_id), []))

    def info(self, frame_id: int) -> list[Any]:
        """The frame's entries in scene_gt_info.json, if there is one."""
        return list(self._infos.get(str(frame_id), []))

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
        for path in sorted(self._folder.glob(f"*{_CAMERA}")):
            stem = path.name.removesuffix(_CAMERA)
            scene, _, frame = stem.rpartition("_")
            if frame.isdecimal() and (not scene or int(scene) == self._number):
                stems[int(frame)] = stem
        return stems

    def _path(self, frame_id: int, ending: str) -> Path:
        stem = self._stems.get(frame_id, f"{self._number:06d}_{frame_id:06d}")
        return self._folder / f"{stem}{ending}"

    @property
    def frame_ids(self) -> tuple[int, ...]:
        """Numbers of the frames with a camera, in order."""
        return tuple(sorted(self._stems))

    @property
    def annotated(self) -> bool:
        """Whether the first frame states true poses."""
        return any(self._path(frame, ".gt.json").is_file() for frame in self.frame_ids[:1])

    def camera(self, frame_id: int) -> dict[str, Any]:
        """The frame's camera.json. Raises DataError if it has no `cam_K`."""
        path = self._path(frame_id, _CAMERA)
        entry: dict[str, Any] = read_json(path)
        if "cam_K" not in entry:
            raise DataError(f"{path} has no cam_K for frame {frame_id}")
        return entry

    def truth(self, frame_id: int) -> list[Any]:
        """The entries of the frame's gt.json."""
        path = self._path(frame_id, ".gt.json")
        if not path.is_file():
            raise _no_poses(path)
        return list(read_json(path))

    def info(self, frame_id: int) -> list[Any]:
        """The entries of the frame's gt_info.json, if there is one."""
        path = self._path(frame_id, ".gt_info.json")
        return list(read_json(path)) if path.is_file() else []

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
        try:
            return path, _from_run_lengths(read_json(path)[str(number)])
        except (KeyError, TypeError, ValueError) as error:
            raise DataError(f"{path} has no mask {number} of run lengths: {error!r}") from error

    def text_files(self, frame_ids: list[int]) -> list[Path]:
        """The JSON files of these frames."""
        endings = (_CAMERA, ".gt.json", ".gt_info.json")
        paths = (self._path(frame, ending) for frame in frame_ids for ending in endings)
        return [path for path in paths if path.is_file()]


def _no_poses(path: Path) -> MissingFileError:
    return MissingFileError(
        f"there is no file {path} with true poses to score against (BOP keeps some private): set"
        " data.split to a folder that has them"
    )


def _from_run_lengths(entry: dict[str, Any]) -> Mask:
    """A mask from COCO's uncompressed run lengths: column by column, starting with False."""
    height, width = (int(each) for each in entry["size"])
    counts = np.asarray(entry["counts"], dtype=np.int64)
    values = np.arange(len(counts)) % 2 == 1
    return np.repeat(values, counts).reshape(width, height).T.copy()
