"""Frames of a data set in BOP's layout (LM, LM-O, IC-BIN and others).

Format: Hodan et al., BOP (ECCV 2018), docs/bop_datasets_format.md of the BOP toolkit.
The files are in millimetres.
"""

from collections.abc import Collection
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from annotated_types import Ge
from jaxtyping import Bool, Float

from hlp.data.bop_models import load_object_models
from hlp.data.dataset import DATASETS, Dataset
from hlp.data.images import camera_matrix, find_image, read_depth, read_rgb, same_size
from hlp.data.sources import content_hash
from hlp.data.training_images import FolderSettings, existing_folder
from hlp.errors import DataError, MissingFileError
from hlp.files import read_json
from hlp.geometry import nearest_rotation, rigid
from hlp.objects.object_model import ObjectSettings
from hlp.records import MILLIMETRE, Frame, Target, frame_key, parse_frame_key
from hlp.settings import Doc

_SCENE_FILES = ("scene_camera.json", "scene_gt.json", "scene_gt_info.json")
# Rotations in files are rounded; a matrix that differs more from a rotation is an error.
_ROUNDING = 0.05

FrameId = tuple[int, int]


@DATASETS.register
@dataclass(frozen=True, kw_only=True)
class BopSettings(FolderSettings):
    """Config group `data`: a data set in BOP's layout."""

    name: Literal["bop"] = "bop"
    root: Annotated[str, Doc("folder with models/ and the split")]
    objects: Annotated[dict[str, ObjectSettings], Doc("objects by name")]
    split: Annotated[str, Doc("folder below root with the scenes")] = "test"
    targets: Annotated[
        str | None,
        Doc("list of targets, below root; null: everything that is annotated"),
    ] = None
    symmetry_steps: Annotated[
        int, Ge(1), Doc("rotations that stand for a continuous symmetry; at most 0.6° off (D)")
    ] = 315

    def build(self) -> Dataset:
        """Objects and frames. Raises FileNotFoundError and ValueError naming what is wrong."""
        root = existing_folder("data.root", self.root)
        training = self.training_images()
        models = load_object_models(root, self.objects, self.proxy_faces, self.symmetry_steps)
        if not (root / self.split).is_dir():
            raise MissingFileError(f"data.split is no folder: {root / self.split} (set data.split)")
        frames = BopFrames(root, self.split, self.targets, models)
        wanted = {object_id for ids in frames.targets.values() for object_id in ids}
        return training.dataset(models, tuple(sorted(wanted)), frames, self)


def list_targets(root: Path, split: str, targets_file: str | None) -> dict[FrameId, dict[int, int]]:
    """(scene, frame) -> object id -> number of instances to find, in file order.

    Without a targets file these are all annotated instances. Raises FileNotFoundError, and
    ValueError if the file is not a BOP targets file.
    """
    if targets_file is None:
        return _annotated(root / split)
    path = root / targets_file
    targets: dict[FrameId, dict[int, int]] = {}
    try:
        for row in read_json(path):
            frame = (int(row["scene_id"]), int(row["im_id"]))
            wanted = targets.setdefault(frame, {})
            wanted[int(row["obj_id"])] = int(row.get("inst_count", 1))
    except (KeyError, TypeError, AttributeError) as error:
        raise DataError(f"{path} is no BOP targets file: {error!r}") from error
    return targets


def load_frame(
    root: Path, split: str, scene_id: int, frame_id: int, wanted: dict[int, int] | None = None
) -> Frame:
    """One frame with its targets: `wanted` (object id -> instances) or all annotated ones.

    If more instances are annotated than wanted, the most visible ones are the targets. Raises
    FileNotFoundError, and ValueError naming the file for a broken image, colour and depth of
    different sizes, a NaN pose, or a wanted object without a pose.
    """
    return BopFrames(root, split, None)._load(scene_id, frame_id, wanted)


class BopFrames:
    """The frames of a split with at least one target (a `FrameSource`).

    Constructing it reads no file. Only objects of `object_ids` are targets (None: all).
    """

    def __init__(
        self,
        root: Path,
        split: str,
        targets_file: str | None,
        object_ids: Collection[int] | None = None,
    ) -> None:
        self._root, self._split, self._targets_file = Path(root), split, targets_file
        self._object_ids = None if object_ids is None else frozenset(object_ids)
        self._scenes: dict[int, tuple[Any, Any, Any]] = {}

    @cached_property
    def targets(self) -> dict[FrameId, dict[int, int]]:
        """(scene, frame) -> object id -> number of instances, sorted by frame."""
        listed = list_targets(self._root, self._split, self._targets_file)
        chosen: dict[FrameId, dict[int, int]] = {}
        for frame, wanted in sorted(listed.items()):
            ids = wanted if self._object_ids is None else self._object_ids
            kept = {i: count for i, count in wanted.items() if i in ids}
            if kept:
                chosen[frame] = kept
        if not chosen:
            raise DataError(
                f"{self._root / (self._targets_file or self._split)} lists no target of the objects"
                f" {sorted(self._object_ids or ())}: check data.targets and data.objects"
            )
        return chosen

    @cached_property
    def keys(self) -> tuple[str, ...]:
        """Frame keys, e.g. `000006_000012`, in order of scene and frame."""
        return tuple(frame_key(*ids) for ids in self.targets)

    def __len__(self) -> int:
        return len(self.targets)

    def load(self, key: str) -> Frame:
        """Decode one frame; raises KeyError for an unknown key and what `load_frame` raises."""
        if key not in self.keys:
            raise KeyError(f"no frame {key!r} with targets under {self._root / self._split}")
        scene_id, frame_id = parse_frame_key(key)
        return self._load(scene_id, frame_id, self.targets[scene_id, frame_id])

    def identity(self) -> str:
        """Hash of images, cameras, poses and the list of targets."""
        files: list[Path] = []
        for scene in sorted({scene for scene, _ in self.targets}):
            folder = self._folder(scene)
            files += [path for name in _SCENE_FILES if (path := folder / name).is_file()]
        for scene, frame in self.targets:
            folder = self._folder(scene)
            files += [find_image(folder / kind, f"{frame:06d}") for kind in ("rgb", "depth")]
        return content_hash(files, extra=repr(list(self.targets.items())))

    def visible_mask(self, frame: Frame, target: Target) -> Bool[np.ndarray, "h w"] | None:
        """The mask in `mask_visib/` of one of the frame's targets; None if there is no such file.

        Raises ValueError naming a mask that is broken or not of the frame's size.
        """
        folder, (_, truths, _) = self._folder(frame.scene_id), self._scene(frame.scene_id)
        annotated = _annotated_targets(truths[str(frame.frame_id)], [], str(folder))
        number = next(
            number
            for number, each in enumerate(annotated)
            if each.object_id == target.object_id
            and np.array_equal(each.pose_cam_obj, target.pose_cam_obj)
        )
        path = folder / "mask_visib" / f"{frame.frame_id:06d}_{number:06d}.png"
        if not path.is_file():
            return None
        mask = read_rgb(path)[..., 0] > 0
        same_size(path, mask, frame.depth)
        return mask

    def _folder(self, scene_id: int) -> Path:
        return self._root / self._split / f"{scene_id:06d}"

    def _scene(self, scene_id: int) -> tuple[Any, Any, Any]:
        if scene_id not in self._scenes:
            folder = self._folder(scene_id)
            info = folder / "scene_gt_info.json"
            self._scenes[scene_id] = (
                read_json(folder / "scene_camera.json"),
                read_json(folder / "scene_gt.json"),
                read_json(info) if info.is_file() else {},
            )
        return self._scenes[scene_id]

    def _load(self, scene_id: int, frame_id: int, wanted: dict[int, int] | None) -> Frame:
        folder = self._folder(scene_id)
        cameras, truths, infos = self._scene(scene_id)
        key = str(frame_id)
        if key not in cameras or "cam_K" not in cameras[key]:
            raise DataError(f"{folder / 'scene_camera.json'} has no cam_K for frame {frame_id}")
        rgb_path = find_image(folder / "rgb", f"{frame_id:06d}")
        rgb = read_rgb(rgb_path)
        scale = float(cameras[key].get("depth_scale", 1.0))
        depth = read_depth(find_image(folder / "depth", f"{frame_id:06d}"), scale)
        same_size(rgb_path, rgb, depth)
        matrix = camera_matrix(cameras[key]["cam_K"], folder / "scene_camera.json")
        where = f"{folder / 'scene_gt.json'}, frame {frame_id}"
        annotated = _annotated_targets(truths.get(key, []), infos.get(key, []), where)
        return Frame(scene_id, frame_id, rgb, depth, matrix, _choose(annotated, wanted, where))


def _annotated(split: Path) -> dict[FrameId, dict[int, int]]:
    if not split.is_dir():
        raise MissingFileError(f"no folder {split}: check data.root and data.split")
    counts: dict[FrameId, dict[int, int]] = {}
    for folder in sorted(path for path in split.iterdir() if path.name.isdigit()):
        for frame, entries in read_json(folder / "scene_gt.json").items():
            wanted = counts.setdefault((int(folder.name), int(frame)), {})
            for entry in entries:
                wanted[int(entry["obj_id"])] = wanted.get(int(entry["obj_id"]), 0) + 1
    return counts


def _annotated_targets(entries: Any, infos: Any, where: str) -> list[Target]:
    visible = [float(info.get("visib_fract", "nan")) for info in infos]
    visible += [float("nan")] * (len(entries) - len(visible))
    return [
        Target(int(entry["obj_id"]), _pose(entry, where), fraction)
        for entry, fraction in zip(entries, visible, strict=False)
    ]


def _pose(entry: dict[str, Any], where: str) -> Float[np.ndarray, "4 4"]:
    where = f"{where}, object {entry['obj_id']}"
    try:
        rotation = np.array(entry["cam_R_m2c"], dtype=np.float64).reshape(3, 3)
        translation = np.array(entry["cam_t_m2c"], dtype=np.float64).reshape(3) * MILLIMETRE
    except (KeyError, TypeError, ValueError) as error:
        raise DataError(f"{where}: no pose of 9 and 3 numbers ({error!r})") from error
    if not (np.isfinite(rotation).all() and np.isfinite(translation).all()):
        raise DataError(f"{where}: the pose holds NaN or infinity: mend or leave out the entry")
    nearest = nearest_rotation(rotation)
    if np.abs(nearest - rotation).max() > _ROUNDING:
        raise DataError(f"{where}: cam_R_m2c is no rotation (row-major, right-handed)")
    return np.asarray(rigid(nearest, translation))


def _choose(
    annotated: list[Target], wanted: dict[int, int] | None, where: str
) -> tuple[Target, ...]:
    if wanted is None:
        return tuple(annotated)
    chosen: list[Target] = []
    for object_id, count in wanted.items():
        instances = [target for target in annotated if target.object_id == object_id]
        if len(instances) < count:
            raise DataError(
                f"{where}: {count} of object {object_id} should be found, {len(instances)} have a"
                f" pose: drop it from the targets or add its pose"
            )
        instances.sort(key=lambda target: -np.nan_to_num(target.visible_fraction, nan=0.0))
        chosen += instances[:count]
    return tuple(chosen)
