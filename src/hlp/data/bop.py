"""Frames of a data set in BOP's layout (LM, LM-O, IC-BIN and others).

Format: Hodan et al., BOP (ECCV 2018), docs/bop_datasets_format.md of the BOP toolkit.
The files are in millimetres.
"""

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from annotated_types import Le

from hlp.arrays import Mask, spread
from hlp.data import bop_models, bop_scenes
from hlp.data.dataset import DATASETS, Dataset, StatedTarget, content_hash
from hlp.data.file_frames import FileFrames, FolderSettings, StatedFrame, existing_folder
from hlp.data.images import read_rgb, require_same_size
from hlp.errors import DataError, MissingFileError
from hlp.objects.object_model import ONLY, ObjectSettings, chosen_objects
from hlp.records import Frame, ObjectModel, Target, frame_key, parse_frame_key
from hlp.settings import Count, Doc, Share


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
    only: Annotated[tuple[str, ...] | None, ONLY] = None
    split: Annotated[
        str,
        Doc(
            "folder below root with the scenes, or what its name begins with (test: "
            "test_primesense); auto: test, test_* or val with true poses"
        ),
    ] = bop_models.AUTO
    targets: Annotated[
        str | None,
        Doc(
            "list of targets, below root; auto: BOP's list if there is one, else everything that "
            "is annotated; null: everything that is annotated"
        ),
    ] = bop_models.AUTO
    min_visible: Annotated[
        Share,
        Doc("instances whose stated visible fraction is less are no targets (BOP's lists: 0.1)"),
    ] = 0.0
    search: Annotated[
        Literal["targets", "all"],
        Doc(
            "targets: in each frame, what its targets name (BOP's localization); all: every object "
            "of the data set, the number of instances not being known (BOP's detection)"
        ),
    ] = "targets"
    empty: Annotated[
        str | None,
        Doc(
            "folder in BOP's layout whose frames show none of the objects: they are searched as "
            "well, the number of instances not being known, to count false alarms"
        ),
    ] = None
    symmetry_steps: Annotated[
        Count, Le(3600), Doc("rotations that stand for a continuous symmetry; at most 0.6° off (D)")
    ] = 315

    def build(self) -> Dataset:
        """Objects and frames. Raises FileNotFoundError and ValueError naming what is wrong."""
        root = existing_folder("data.root", self.root)
        images = self.training_images()
        named = self._named(root)
        given = self._models(root, named) if named else None
        frames, ids = self._searched(root, given)
        models = given or self._models(root, bop_models.name_objects(root, ids))
        return Dataset(
            models,
            ids,
            frames,
            **vars(images),
            search_all=self.search == "all",
            settings=self,
            evaluation_mesh_files=bop_models.evaluation_meshes(root, models),
            vsd_delta=0.005 if root.name == "itodd" else Dataset.vsd_delta,  # as the toolkit has it
            empty_frames=None if self.empty is None else self._empty_frames(self.empty),
        )

    def extent(self, most: int | None) -> tuple["BopFrames", tuple[int, int, int]]:
        """Frames; numbers of objects, images (at most `most`), and searches for one in an image.

        No model or image is read. Raises as `build`.
        """
        root = existing_folder("data.root", self.root)
        frames, ids = self._searched(root, [own.id for own in self._named(root).values()] or None)
        kept = spread(list(frames.targets.values()), most)
        every = self.search == "all"
        searches = sum(len(ids) if every else len(own) for own in kept)
        return frames, (len(ids), len(kept), searches)

    def _named(self, root: Path) -> Mapping[str, ObjectSettings]:
        """The objects that the settings name; none if they are those that are targets."""
        named = self.objects
        if self.only is not None and not named:
            named = bop_models.name_objects(root, bop_models.list_objects(root))
        return chosen_objects(named, self.only) if named else {}

    def _searched(
        self, root: Path, given: Collection[int] | None
    ) -> tuple["BopFrames", tuple[int, ...]]:
        """The frames, and the objects that are looked for in them, `given` or found."""
        split, every = bop_models.find_split(root, self.split), self.search == "all"
        listed = None if self.targets is None else root / self.targets
        if self.targets == bop_models.AUTO:
            # The list of 2019 states objects and their numbers, that of 2024 only the frames.
            kind, years = split.partition("_")[0], (24, 19) if every else (19, 24)
            paths = (root / f"{kind}_targets_bop{year}.json" for year in years)
            listed = next((path for path in paths if path.is_file()), None)
        of = root / split, listed, given, self.min_visible, every
        frames = BopFrames(*of, max_megapixels=self.max_megapixels)
        if every:
            return frames, tuple(given or bop_models.list_objects(root))
        return frames, tuple(sorted({i for counts in frames.targets.values() for i in counts}))

    def _empty_frames(self, folder: str) -> "BopFrames":
        root = existing_folder("data.empty", folder)
        of = root / bop_models.find_split(root), None, ()
        return BopFrames(*of, every_frame=True, max_megapixels=self.max_megapixels)

    def _models(self, root: Path, objects: Mapping[str, ObjectSettings]) -> dict[int, ObjectModel]:
        return bop_models.load_object_models(root, objects, self.proxy_faces, self.symmetry_steps)


@dataclass(eq=False)
class BopFrames(FileFrames):
    """The frames of a split with at least one target (a `FrameSource`).

    `targets_file` is BOP's list of targets (None: everything that is annotated).
    Only objects of `object_ids` are targets (None: all), and only instances that are visible to at
    least `min_visible`, where the data set states it. If more instances are annotated than are to
    be found, the most visible ones are the targets. Where BOP keeps the true poses private, frames
    have none, and `stated_targets` says what is to be found. With `every_frame`, listed frames
    without a target are kept.
    """

    targets_file: Path | None
    object_ids: Collection[int] | None = None
    min_visible: float = 0.0
    every_frame: bool = False

    @cached_property
    def targets(self) -> dict[bop_scenes.FrameId, dict[int, int]]:
        """(scene, frame) -> object id -> number of instances, sorted by frame."""
        listed = bop_scenes.list_targets(self._scenes, self.targets_file, self.min_visible)
        ids = self.object_ids
        chosen: dict[bop_scenes.FrameId, dict[int, int]] = {}
        for frame, counts in sorted(listed.items()):
            kept = {i: count for i, count in counts.items() if ids is None or i in ids}
            scene = self._scenes.get(frame[0])
            if self.every_frame or kept or (scene is not None and scene.is_broken(frame[1])):
                chosen[frame] = kept
        if not chosen and self._is_private:
            raise MissingFileError(
                f"{self.root} has no {bop_scenes.TRUTH} with true poses (BOP keeps some private), "
                "and no list of targets names an object: set data.split to a folder that has them"
            )
        if not chosen:
            named = "any object" if ids is None else f"objects {sorted(ids)}"
            raise DataError(
                f"{self.targets_file or self.root} lists no target of {named}: check"
                " data.targets, data.objects and data.min_visible"
            )
        return chosen

    @cached_property
    def _entries(self) -> dict[str, dict[int, int]]:
        """Numbers of instances by object, in order of scene and frame."""
        return {frame_key(*frame): counts for frame, counts in self.targets.items()}

    def stated_targets(self, key: str) -> tuple[StatedTarget, ...]:
        """See `CheckedFrames`."""
        frame = parse_frame_key(key)
        scene = self._scenes.get(frame[0])
        there = [] if scene is None else scene.stated_instances(frame[1])
        stated: list[StatedTarget] = []
        for object_id, count in self._entries[key].items():
            fractions = sorted((f for i, f in there if i == object_id), key=lambda f: -f)
            fractions += [float("nan")] * (count - len(fractions))
            stated += [(object_id, fraction) for fraction in fractions[:count]]
        return tuple(stated)

    def identity(self) -> str:
        """Hash of images, cameras, poses and the list of targets, and of what is missing."""
        scenes = {i: self._scenes[i] for i, _ in self.targets if i in self._scenes}
        texts = [path for scene in scenes.values() for path in scene.text_files]
        images = [
            scenes[scene_id].image(kinds, frame)
            for scene_id, frame in self.targets
            if scene_id in scenes
            for kinds in (bop_scenes.COLOR, bop_scenes.DEPTH)
        ]
        return content_hash([*texts, *images], repr(list(self.targets.items())))

    def visible_mask(self, frame: Frame, target: Target) -> Mask | None:
        """The data set's mask of one of the frame's targets; None if there is no such file.

        Raises DataError naming a mask that is broken or not of the frame's size.
        """
        scene = self._scene(frame.scene_id)
        there = [(t.object_id, t.pose_cam_obj.tolist()) for t in scene.targets(frame.frame_id)]
        number = there.index((target.object_id, target.pose_cam_obj.tolist()))
        path = scene.visible_mask(frame.frame_id, number)
        if not path.is_file():
            return None
        mask = read_rgb(path)[..., 0] > 0
        require_same_size(path, mask.shape[::-1], frame.depth.shape[::-1])
        return np.asarray(mask)

    @cached_property
    def _is_private(self) -> bool:
        """Whether no scene states true poses; where some do, the others lack a file."""
        return not any(scene.annotated for scene in self._scenes.values())

    @cached_property
    def _scenes(self) -> dict[int, bop_scenes.Scene]:
        return bop_scenes.list_scenes(self.root)

    def _scene(self, scene_id: int) -> bop_scenes.Scene:
        if scene_id not in self._scenes:
            raise MissingFileError(f"no scene {scene_id} in {self.root}")
        return self._scenes[scene_id]

    def _stated(self, key: str) -> StatedFrame:
        scene_id, frame_id = parse_frame_key(key)
        scene = self._scene(scene_id)
        camera, where = scene.camera(frame_id), scene.where(frame_id)
        found: tuple[Target, ...] = ()
        if not self._is_private:
            found = bop_scenes.most_visible(scene.targets(frame_id), self._entries[key], where)
        return StatedFrame(
            scene.image(bop_scenes.COLOR, frame_id),
            scene.image(bop_scenes.DEPTH, frame_id),
            camera.depth_scale,
            np.array(camera.cam_K, dtype=np.float64).reshape(3, 3),
            f"{scene.where(frame_id, bop_scenes.CAMERA)}: cam_K",
            [(target, f"{where}, object {target.object_id}: cam_t_m2c") for target in found],
        )
