"""Targets of a BOP data set: which instances are to be found, and their true poses.

Format: Hodan et al., BOP (ECCV 2018), docs/bop_datasets_format.md of the BOP toolkit.
"""

from collections import Counter
from collections.abc import Mapping, Sequence
from itertools import zip_longest
from pathlib import Path

import numpy as np

from hlp import schemas
from hlp.arrays import Pose
from hlp.data.bop_scenes import Scene
from hlp.errors import DataError, HlpError
from hlp.geometry import rigid
from hlp.records import MILLIMETRE, Target
from hlp.schemas import exact_rotation
from hlp.settings import read_as

FrameId = tuple[int, int]


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
    for row in read_as(targets_file, schemas.Targets):
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


def annotated_targets(scene: Scene, frame_id: int, where: str) -> list[Target]:
    """All annotated instances of a frame.

    Raises DataError naming `where` for a broken pose, and for visible fractions of another number
    of instances.
    """
    entries, infos = scene.truth(frame_id), scene.info(frame_id)
    if entries and infos and len(entries) != len(infos):
        files = scene.text_files([frame_id])
        about = next(file for file in files if file.name.endswith("gt_info.json"))
        raise DataError(
            f"{where}: {about} has {len(infos)} instances, but there are {len(entries)} poses: "
            "they must be the same ones in the same order"
        )
    stated = [info.visib_fract for info in infos] or [None] * len(entries)
    visible = [float("nan") if fraction is None else fraction for fraction in stated]
    return [
        Target(entry.obj_id, _pose(entry, where), fraction)
        for entry, fraction in zip(entries, visible, strict=False)
    ]


def is_broken(scene: Scene, frame_id: int) -> bool:
    """Whether the annotations of a frame cannot be read."""
    try:
        scene.truth(frame_id), scene.info(frame_id)
    except HlpError:
        return True
    return False


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


def stated_instances(scene: Scene, frame_id: int) -> list[tuple[int, float]]:
    """Object and visible fraction (nan: not stated) of what is annotated in a frame.

    Also of a frame whose annotations are broken, as far as they can be read.
    """
    entries, infos = (part if isinstance(part, list) else [] for part in scene.unchecked(frame_id))
    found = []
    for entry, info in zip_longest(entries, infos[: len(entries)]):
        object_id = entry.get("obj_id") if isinstance(entry, dict) else None
        fraction = info.get("visib_fract") if isinstance(info, dict) else None
        if not isinstance(fraction, int | float) or not 0 <= fraction <= 1:
            fraction = float("nan")
        if type(object_id) is int:
            found.append((object_id, float(fraction)))
    return found


def _visible(scenes: Mapping[int, Scene], frame: FrameId, min_visible: float) -> dict[int, int]:
    """Number of annotated instances of each object that are visible enough."""
    scene = scenes.get(frame[0])
    if scene is None:
        return {}
    instances = stated_instances(scene, frame[1])
    return dict(Counter(i for i, fraction in instances if not fraction < min_visible))


def _pose(entry: schemas.TruthEntry, where: str) -> Pose:
    where = f"{where}, object {entry.obj_id}: cam_R_m2c"
    rotation = np.array(entry.cam_R_m2c, dtype=np.float64).reshape(3, 3)
    translation = np.array(entry.cam_t_m2c, dtype=np.float64) * MILLIMETRE
    return np.asarray(rigid(exact_rotation(rotation, where), translation))
