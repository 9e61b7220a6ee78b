"""Scenes of a BOP data set on disk: which instances are annotated, and which are to be found.

SCENE/rgb/000012.png (or gray), depth/000012.png, mask_visib/000012_000000.png, and the text files
scene_camera.json, scene_gt.json and scene_gt_info.json, which have an entry for each frame.

Format: Hodan et al., BOP (ECCV 2018), docs/bop_datasets_format.md of the BOP toolkit.
"""

from collections import Counter
from collections.abc import Mapping, Sequence
from functools import cache
from itertools import zip_longest
from pathlib import Path
from typing import Any

import numpy as np

from hlp import schemas
from hlp.arrays import Pose
from hlp.data.images import find_image
from hlp.errors import DataError, HlpError, MissingFileError
from hlp.geometry import rigid
from hlp.records import MILLIMETRE, Target
from hlp.schemas import exact_rotation
from hlp.settings import read_as, stored_as

COLOR, DEPTH = ("rgb", "gray"), ("depth",)
"""Folders of images; the first that is there counts."""
CAMERA, TRUTH, _INFO = "scene_camera.json", "scene_gt.json", "scene_gt_info.json"
FrameId = tuple[int, int]


class Scene:
    """The files of one scene, read when they are asked for. Errors name the file and the frame."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._read = cache(lambda name: read_as(folder / name, dict[str, Any]))  # by frame

    @property
    def annotated(self) -> bool:
        """Whether the scene states true poses."""
        return (self._folder / TRUTH).is_file()

    @property
    def frame_ids(self) -> tuple[int, ...]:
        """Numbers of the frames with a camera or with poses, in order."""
        numbers: set[int] = set()
        for name in (CAMERA, TRUTH) if self.annotated else (CAMERA,):
            try:
                numbers |= {*map(schemas.whole_id, self._read(name))}
            except ValueError as error:
                raise DataError(f"{self._folder / name}: {error}") from error
        return tuple(sorted(numbers))

    @property
    def text_files(self) -> list[Path]:
        """The files that state cameras and poses."""
        paths = [self._folder / name for name in (CAMERA, TRUTH, _INFO)]
        return [path for path in paths if path.is_file()]

    def image(self, kinds: tuple[str, ...], frame_id: int) -> Path:
        """The image of the first of these kinds that is there, or where it should be."""
        there = [kind for kind in kinds if (self._folder / kind).is_dir()] or kinds
        return find_image(self._folder / there[0], f"{frame_id:06d}")

    def visible_mask(self, frame_id: int, number: int) -> Path:
        """The mask of the pixels that show the annotated instance of this number."""
        return self._folder / "mask_visib" / f"{frame_id:06d}_{number:06d}.png"

    def where(self, frame_id: int, name: str = TRUTH) -> str:
        """How messages call the entry of a frame in a text file."""
        return f"{self._folder / name}, frame {frame_id}"

    def camera(self, frame_id: int) -> schemas.CameraEntry:
        """The frame's camera. Raises DataError if there is none, or a broken one."""
        return stored_as(schemas.CameraEntry, *self._entry(CAMERA, frame_id))

    def annotations(
        self, frame_id: int
    ) -> tuple[list[schemas.TruthEntry], list[schemas.InfoEntry]]:
        """The annotated instances, and in their order what is stated beside poses, if any."""
        entries = stored_as(list[schemas.TruthEntry], *self._entry(TRUTH, frame_id))
        return entries, stored_as(list[schemas.InfoEntry], *self._entry(_INFO, frame_id))

    def is_broken(self, frame_id: int) -> bool:
        """Whether there are annotations of a frame that cannot be read."""
        try:
            return self.annotated and self.annotations(frame_id) is None
        except HlpError:
            return True

    def targets(self, frame_id: int) -> list[Target]:
        """All annotated instances of a frame.

        Raises DataError for a broken pose, and for visible fractions of other instances.
        """
        entries, infos = self.annotations(frame_id)
        if entries and infos and len(entries) != len(infos):
            raise DataError(
                f"{self._folder / _INFO} has {len(infos)} instances in frame {frame_id}, but there "
                f"are {len(entries)} poses: they must be the same ones in the same order"
            )
        stated = [info.visib_fract for info in infos] or [None] * len(entries)
        visible = [float("nan") if fraction is None else fraction for fraction in stated]
        return [
            Target(entry.obj_id, _pose(entry, self.where(frame_id)), fraction)
            for entry, fraction in zip(entries, visible, strict=False)
        ]

    def stated_instances(self, frame_id: int) -> list[tuple[int, float]]:
        """Object and visible fraction (nan: not stated) of what is annotated in a frame.

        Also of a frame whose annotations are broken, as far as they can be read.
        """
        if not self.annotated:
            return []
        parts = (self._entry(name, frame_id)[0] for name in (TRUTH, _INFO))
        entries, infos = (part if isinstance(part, list) else [] for part in parts)
        found = []
        for entry, info in zip_longest(entries, infos[: len(entries)]):
            object_id = entry.get("obj_id") if isinstance(entry, dict) else None
            fraction = info.get("visib_fract") if isinstance(info, dict) else None
            if not isinstance(fraction, int | float) or not 0 <= fraction <= 1:
                fraction = float("nan")
            if type(object_id) is int:
                found.append((object_id, float(fraction)))
        return found

    def _entry(self, name: str, frame_id: int) -> tuple[Any, str]:
        """What a text file states of a frame, empty if nothing; and where."""
        where = self.where(frame_id, name)
        if name == _INFO and not (self._folder / name).is_file():
            return [], where
        return self._read(name).get(str(frame_id), {} if name == CAMERA else []), where


def _pose(entry: schemas.TruthEntry, where: str) -> Pose:
    where = f"{where}, object {entry.obj_id}: cam_R_m2c"
    rotation = np.array(entry.cam_R_m2c, dtype=np.float64).reshape(3, 3)
    translation = np.array(entry.cam_t_m2c, dtype=np.float64) * MILLIMETRE
    return np.asarray(rigid(exact_rotation(rotation, where), translation))


def list_scenes(split: Path) -> dict[int, Scene]:
    """The scenes of a split by number, in order.

    Raises MissingFileError if there is none, DataError if two folders have one number.
    """
    if not split.is_dir():
        raise MissingFileError(f"no folder {split}: check data.root and data.split")
    scenes: dict[int, Scene] = {}
    for folder in sorted(path for path in split.iterdir() if path.is_dir()):
        if folder.name.isdecimal():
            number = int(folder.name)
            if number in scenes:
                raise DataError(f"{split} has two folders of scene {number}: leave one out")
            scenes[number] = Scene(folder)
    if not scenes:
        raise MissingFileError(
            f"no scene in {split}, no folder with a number and scene_camera.json: check data.root "
            "and data.split"
        )
    return dict(sorted(scenes.items()))


def list_targets(
    scenes: Mapping[int, Scene], targets_file: Path | None, min_visible: float = 0.0
) -> dict[FrameId, dict[int, int]]:
    """(scene, frame) -> object id -> number of instances to find, in file order.

    Without a targets file these are all annotated instances; so are those of a frame that the file
    lists without an object, as BOP's lists for detection do. Instances that are less visible than
    `min_visible` do not count, unless their visibility is not stated. Frames whose annotations are
    broken are listed with what can be read of them. Raises FileNotFoundError, and ValueError if the
    file is not a BOP targets file.
    """
    if targets_file is None:
        frames = [(number, frame) for number, scene in scenes.items() for frame in scene.frame_ids]
        return {frame: _visible(scenes, frame, min_visible) for frame in frames}
    targets: dict[FrameId, dict[int, int]] = {}
    for row in read_as(targets_file, list[schemas.TargetRow]):
        counts = targets.setdefault((row.scene_id, row.im_id), {})
        if row.obj_id is not None:
            if row.obj_id in counts:
                raise DataError(
                    f"{targets_file} lists object {row.obj_id} of scene {row.scene_id}, image "
                    f"{row.im_id} twice: write one row with inst_count"
                )
            counts[row.obj_id] = row.inst_count
    for frame, counts in targets.items():
        if not counts or min_visible > 0:
            there = _visible(scenes, frame, min_visible)
            limit = counts or there
            targets[frame] = {i: min(n, limit[i]) for i, n in there.items() if i in limit}
    return targets


def _visible(scenes: Mapping[int, Scene], frame: FrameId, min_visible: float) -> dict[int, int]:
    """Number of annotated instances of each object that are visible enough."""
    scene = scenes.get(frame[0])
    instances = [] if scene is None else scene.stated_instances(frame[1])
    return dict(Counter(i for i, fraction in instances if not fraction < min_visible))


def most_visible(
    annotated: Sequence[Target], counts: Mapping[int, int], where: str
) -> tuple[Target, ...]:
    """The most visible instances of each object, as many as `counts` says (id -> number).

    Raises ValueError naming `where` if an object has fewer instances.
    """
    chosen: list[Target] = []
    for object_id, count in counts.items():
        instances = [target for target in annotated if target.object_id == object_id]
        if len(instances) < count:
            raise DataError(
                f"{where}: {count} of object {object_id} should be found, {len(instances)} have a"
                f" pose: drop it from the targets or add its pose"
            )
        instances.sort(key=lambda target: -np.nan_to_num(target.visible_fraction, nan=0.0))
        chosen += instances[:count]
    return tuple(chosen)
