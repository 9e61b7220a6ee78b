"""Frames of a data set in BOP's layout (LM, LM-O, IC-BIN and others).

Format: Hodan et al., BOP (ECCV 2018), docs/bop_datasets_format.md of the BOP toolkit.
The files are in millimetres.
"""

import logging
import os
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from annotated_types import Ge, Interval, Le
from jaxtyping import Bool, Float

from hlp.data.bop_models import (
    AUTO,
    evaluation_meshes,
    find_split,
    find_targets_file,
    load_object_models,
    name_objects,
)
from hlp.data.bop_scenes import COLOR, Scene, list_scenes
from hlp.data.bop_targets import (
    FrameId,
    annotated_targets,
    is_broken,
    list_targets,
    most_visible,
    stated_instances,
)
from hlp.data.dataset import DATASETS, Dataset, StatedTarget, content_hash
from hlp.data.images import (
    depth_image_size,
    image_size,
    read_depth,
    read_rgb,
    require_same_size,
    same_size,
)
from hlp.data.training_images import MAX_MEGAPIXELS, FolderSettings, existing_folder
from hlp.errors import DataError, MissingFileError
from hlp.geometry import transform
from hlp.objects.object_model import ObjectSettings
from hlp.records import Frame, ObjectModel, Target, frame_key, parse_frame_key
from hlp.schemas.meaning import (
    require_camera,
    require_depths,
    require_in_front,
    require_near_depths,
)
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
        int,
        Ge(1),
        Le(3600),
        Doc("rotations that stand for a continuous symmetry; at most 0.6° off (D)"),
    ] = 315

    def build(self) -> Dataset:
        """Objects and frames. Raises FileNotFoundError and ValueError naming what is wrong."""
        root = existing_folder("data.root", self.root)
        training = self.training_images()
        given = self._models(root, self.objects) if self.objects else None
        split = find_split(root) if self.split == AUTO else self.split
        existing_folder("data.split", str(root / split))
        listed = find_targets_file(root, split) if self.targets == AUTO else self.targets
        frames = BopFrames(root, split, listed, given, self.min_visible, self.max_megapixels)
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
        max_megapixels: float = MAX_MEGAPIXELS,
    ) -> None:
        self._root, self._split, self._targets_file = Path(root), split, targets_file
        self._object_ids = None if object_ids is None else frozenset(object_ids)
        self._min_visible, self._max_megapixels = min_visible, max_megapixels

    @cached_property
    def targets(self) -> dict[FrameId, dict[int, int]]:
        """(scene, frame) -> object id -> number of instances, sorted by frame."""
        path = None if self._targets_file is None else self._root / self._targets_file
        listed = list_targets(self._scenes, path, self._min_visible)
        chosen: dict[FrameId, dict[int, int]] = {}
        for frame, wanted in sorted(listed.items()):
            allowed = wanted if self._object_ids is None else self._object_ids
            kept = {i: count for i, count in wanted.items() if i in allowed}
            scene = self._scenes.get(frame[0])
            if kept or (scene is not None and is_broken(scene, frame[1])):
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
        """Decode one frame with its targets.

        Raises what `read` raises, and ValueError naming the file for depths that no camera measures
        and poses that are not where the image has depth.
        """
        frame = self.read(key)
        scene, where = self._scene(frame.scene_id), self._where(frame.scene_id, frame.frame_id)
        require_depths(frame.depth, str(self._images(scene, frame.frame_id)[1]))
        for target in frame.targets:
            named = f"{where}, object {target.object_id}: cam_t_m2c"
            require_near_depths(target.pose_cam_obj[:3, 3], frame.depth, named)
        return frame

    def read(self, key: str) -> Frame:
        """One frame as its files state it, whether that makes sense or not.

        If more instances are annotated than wanted, the most visible ones are the targets. Raises
        KeyError for an unknown key, FileNotFoundError, and ValueError naming the file for a broken
        image, colour and depth of different sizes, a NaN pose, or a wanted object without a pose.
        """
        if key not in self.keys:
            raise KeyError(f"no frame {key!r} with targets under {self._root / self._split}")
        scene_id, frame_id = parse_frame_key(key)
        scene = self._scene(scene_id)
        scale = scene.camera(frame_id).depth_scale
        rgb_path, depth_path = self._images(scene, frame_id)
        rgb = read_rgb(rgb_path)
        depth = read_depth(depth_path, scale)
        same_size(rgb_path, rgb, depth)
        matrix = self._camera_matrix(scene, frame_id)
        targets = self._targets_in(scene_id, frame_id)
        return Frame(scene_id, frame_id, rgb, depth, matrix, targets)

    def check(self, key: str, models: Mapping[int, ObjectModel]) -> None:
        """See `CheckedFrames`."""
        scene_id, frame_id = parse_frame_key(key)
        scene = self._scene(scene_id)
        rgb_path, depth_path = self._images(scene, frame_id)
        size = image_size(rgb_path, self._max_megapixels)
        depth_size = depth_image_size(depth_path, self._max_megapixels)
        require_same_size(rgb_path, size, depth_size)
        where = self._where(scene_id, frame_id)
        require_camera(self._camera_matrix(scene, frame_id), size, f"{where}: cam_K")
        for target in self._targets_in(scene_id, frame_id):
            if (model := models.get(target.object_id)) is not None:
                center = transform(target.pose_cam_obj, model.centroid[None])[0]
                named = f"{where}, object {target.object_id}: cam_t_m2c"
                require_in_front(center, model.diameter, named)

    def stated_targets(self, key: str) -> tuple[StatedTarget, ...]:
        """See `CheckedFrames`."""
        frame = parse_frame_key(key)
        scene = self._scenes.get(frame[0])
        stated: list[StatedTarget] = []
        for object_id, count in self.targets[frame].items():
            there = [] if scene is None else stated_instances(scene, frame[1])
            fractions = sorted((f for i, f in there if i == object_id), key=lambda f: -f)
            fractions += [float("nan")] * (count - len(fractions))
            stated += [StatedTarget(object_id, each) for each in fractions[:count]]
        return tuple(stated)

    def _images(self, scene: Scene, frame_id: int) -> tuple[Path, Path]:
        return scene.image(COLOR, frame_id), scene.image(("depth",), frame_id)

    def _camera_matrix(self, scene: Scene, frame_id: int) -> Float[np.ndarray, "3 3"]:
        return np.array(scene.camera(frame_id).cam_K, dtype=np.float64).reshape(3, 3)

    def _targets_in(self, scene_id: int, frame_id: int) -> tuple[Target, ...]:
        where = self._where(scene_id, frame_id)
        annotated = annotated_targets(self._scene(scene_id), frame_id, where)
        return most_visible(annotated, self.targets[scene_id, frame_id], where)

    def identity(self) -> str:
        """Hash of images, cameras, poses and the list of targets, and of what is missing."""
        frames: dict[int, list[int]] = {}
        for scene, frame in self.targets:
            frames.setdefault(scene, []).append(frame)
        files: list[Path] = []
        missing: list[str] = []
        for scene_id, ids in frames.items():
            if scene_id in self._scenes:
                files += self._scenes[scene_id].text_files(ids)
        for scene_id, frame in self.targets:
            for kinds in (COLOR, ("depth",)):
                try:
                    files.append(self._scene(scene_id).image(kinds, frame))
                except MissingFileError:
                    missing.append(f"{kinds[0]} {frame_key(scene_id, frame)}")
        unreadable = [path for path in files if not os.access(path, os.R_OK)]
        missing += [f"unreadable {path.name}" for path in unreadable]
        said = repr(list(self.targets.items())) + (repr(missing) if missing else "")
        return content_hash([path for path in files if path not in unreadable], extra=said)

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
