"""Frames of a data set in BOP's layout (LM, LM-O, IC-BIN and others).

Format: Hodan et al., BOP (ECCV 2018), docs/bop_datasets_format.md of the BOP toolkit.
The files are in millimetres.
"""

import logging
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from annotated_types import Ge, Interval
from jaxtyping import Bool

from hlp.data.bop_layout import AUTO, find_split, find_targets_file
from hlp.data.bop_models import evaluation_meshes, load_object_models, name_objects
from hlp.data.bop_scenes import COLOR, Scene, list_scenes
from hlp.data.bop_targets import FrameId, annotated_targets, list_targets, most_visible
from hlp.data.dataset import DATASETS, Dataset
from hlp.data.images import camera_matrix, read_depth, read_rgb, same_size
from hlp.data.sources import content_hash
from hlp.data.training_images import FolderSettings, existing_folder
from hlp.errors import DataError, MissingFileError
from hlp.objects.object_model import ObjectSettings
from hlp.records import Frame, ObjectModel, Target, frame_key, parse_frame_key
from hlp.settings import Doc


@DATASETS.register
@dataclass(frozen=True, kw_only=True)
class BopSettings(FolderSettings):
    """Config group `data`: a data set in BOP's layout."""

    name: Literal["bop"] = "bop"
    root: Annotated[str, Doc("folder with models/ and the split")]
    objects: Annotated[
        dict[str, ObjectSettings],
        Doc("objects by name; empty: those that are targets, named by models/names.json or id"),
    ] = field(default_factory=dict)
    split: Annotated[
        str, Doc("folder below root with the scenes; auto: test, test_* or val with true poses")
    ] = AUTO
    targets: Annotated[
        str | None,
        Doc(
            "list of targets, below root; auto: BOP's list if there is one, else everything that "
            "is annotated; null: everything that is annotated"
        ),
    ] = AUTO
    min_visible: Annotated[
        float,
        Interval(ge=0, le=1),
        Doc("instances whose stated visible fraction is less are no targets (BOP's lists: 0.1)"),
    ] = 0.0
    search: Annotated[
        Literal["targets", "all"],
        Doc(
            "targets: in each frame, what its targets name (BOP's task); all: every object of the "
            "data set, to count false alarms"
        ),
    ] = "targets"
    symmetry_steps: Annotated[
        int, Ge(1), Doc("rotations that stand for a continuous symmetry; at most 0.6° off (D)")
    ] = 315

    def build(self) -> Dataset:
        """Objects and frames. Raises FileNotFoundError and ValueError naming what is wrong."""
        root = existing_folder("data.root", self.root)
        training = self.training_images()
        given = self._models(root, self.objects) if self.objects else None
        split = find_split(root) if self.split == AUTO else self.split
        existing_folder("data.split", str(root / split))
        listed = find_targets_file(root, split) if self.targets == AUTO else self.targets
        frames = BopFrames(root, split, listed, given, self.min_visible)
        wanted = {object_id for ids in frames.targets.values() for object_id in ids}
        models = given or self._models(root, name_objects(root, sorted(wanted)))
        if self.photographs is None and self.rooms is None:
            logging.getLogger(__name__).info(
                "Backgrounds in training are procedural: data.photographs and data.rooms name none"
            )
        dataset = training.dataset(models, tuple(sorted(wanted)), frames, self)
        meshes = evaluation_meshes(root, models)
        return replace(dataset, search_all=self.search == "all", evaluation_mesh_files=meshes)

    def _models(self, root: Path, objects: Mapping[str, ObjectSettings]) -> dict[int, ObjectModel]:
        return load_object_models(root, objects, self.proxy_faces, self.symmetry_steps)


class BopFrames:
    """The frames of a split with at least one target (a `FrameSource`).

    Constructing it reads no file. Only objects of `object_ids` are targets (None: all), and only
    instances that are visible to at least `min_visible`, where the data set states it.
    """

    def __init__(
        self,
        root: Path,
        split: str,
        targets_file: str | None,
        object_ids: Collection[int] | None = None,
        min_visible: float = 0.0,
    ) -> None:
        self._root, self._split, self._targets_file = Path(root), split, targets_file
        self._object_ids = None if object_ids is None else frozenset(object_ids)
        self._min_visible = min_visible

    @cached_property
    def targets(self) -> dict[FrameId, dict[int, int]]:
        """(scene, frame) -> object id -> number of instances, sorted by frame."""
        path = None if self._targets_file is None else self._root / self._targets_file
        listed = list_targets(self._scenes, path, self._min_visible)
        chosen: dict[FrameId, dict[int, int]] = {}
        for frame, wanted in sorted(listed.items()):
            allowed = wanted if self._object_ids is None else self._object_ids
            kept = {i: count for i, count in wanted.items() if i in allowed}
            if kept:
                chosen[frame] = kept
        if not chosen:
            ids = self._object_ids
            named = "any object" if ids is None else f"objects {sorted(ids)}"
            raise DataError(
                f"{path or self._root / self._split} lists no target of {named}: check"
                " data.targets, data.objects and data.min_visible"
            )
        return chosen

    @cached_property
    def keys(self) -> tuple[str, ...]:
        """Frame keys, e.g. `000006_000012`, in order of scene and frame."""
        return tuple(frame_key(*ids) for ids in self.targets)

    def __len__(self) -> int:
        return len(self.targets)

    def load(self, key: str) -> Frame:
        """Decode one frame with its targets; raises KeyError for an unknown key.

        If more instances are annotated than wanted, the most visible ones are the targets. Raises
        FileNotFoundError, and ValueError naming the file for a broken image, colour and depth of
        different sizes, a NaN pose, or a wanted object without a pose.
        """
        if key not in self.keys:
            raise KeyError(f"no frame {key!r} with targets under {self._root / self._split}")
        scene_id, frame_id = parse_frame_key(key)
        scene, where = self._scene(scene_id), self._where(scene_id, frame_id)
        camera = scene.camera(frame_id)
        rgb_path = scene.image(COLOR, frame_id)
        rgb = read_rgb(rgb_path)
        scale = float(camera.get("depth_scale", 1.0))
        depth = read_depth(scene.image(("depth",), frame_id), scale)
        same_size(rgb_path, rgb, depth)
        matrix = camera_matrix(camera["cam_K"], Path(where))
        annotated = annotated_targets(scene, frame_id, where)
        wanted = self.targets[scene_id, frame_id]
        targets = most_visible(annotated, wanted, where)
        return Frame(scene_id, frame_id, rgb, depth, matrix, targets)

    def identity(self) -> str:
        """Hash of images, cameras, poses and the list of targets."""
        frames: dict[int, list[int]] = {}
        for scene, frame in self.targets:
            frames.setdefault(scene, []).append(frame)
        files: list[Path] = []
        for scene_id, ids in frames.items():
            files += self._scene(scene_id).text_files(ids)
        for scene_id, frame in self.targets:
            found = self._scene(scene_id)
            files += [found.image(COLOR, frame), found.image(("depth",), frame)]
        return content_hash(files, extra=repr(list(self.targets.items())))

    def visible_mask(self, frame: Frame, target: Target) -> Bool[np.ndarray, "h w"] | None:
        """The data set's mask of one of the frame's targets; None if there is no such file.

        Raises ValueError naming a mask that is broken or not of the frame's size.
        """
        scene = self._scene(frame.scene_id)
        where = self._where(frame.scene_id, frame.frame_id)
        number = next(
            number
            for number, each in enumerate(annotated_targets(scene, frame.frame_id, where))
            if each.object_id == target.object_id
            and np.array_equal(each.pose_cam_obj, target.pose_cam_obj)
        )
        found = scene.visible_mask(frame.frame_id, number)
        if found is None:
            return None
        same_size(*found, frame.depth)
        return found[1]

    @cached_property
    def _scenes(self) -> dict[int, Scene]:
        return list_scenes(self._root / self._split)

    def _scene(self, scene_id: int) -> Scene:
        if scene_id not in self._scenes:
            raise MissingFileError(f"no scene {scene_id} in {self._root / self._split}")
        return self._scenes[scene_id]

    def _where(self, scene_id: int, frame_id: int) -> str:
        return f"{self._root / self._split}, scene {scene_id}, frame {frame_id}"
