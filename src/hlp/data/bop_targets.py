"""Targets of a BOP data set: which instances are to be found, and their true poses.

Format: Hodan et al., BOP (ECCV 2018), docs/bop_datasets_format.md of the BOP toolkit.
"""

from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from hlp.data.bop_scenes import Scene
from hlp.errors import DataError
from hlp.files import read_json
from hlp.geometry import nearest_rotation, rigid
from hlp.records import MILLIMETRE, Target

# Rotations in files are rounded; a matrix that differs more from a rotation is an error.
_ROUNDING = 0.05

FrameId = tuple[int, int]


def list_targets(
    scenes: Mapping[int, Scene], targets_file: Path | None, min_visible: float = 0.0
) -> dict[FrameId, dict[int, int]]:
    """(scene, frame) -> object id -> number of instances to find, in file order.

    Without a targets file these are all annotated instances; so are those of a frame that the file
    lists without an object, as BOP's lists for detection do. Instances that are less visible than
    `min_visible` do not count, unless their visibility is not stated. Raises FileNotFoundError, and
    ValueError if the file is not a BOP targets file.
    """
    if targets_file is None:
        frames = [(number, frame) for number, scene in scenes.items() for frame in scene.frame_ids]
        return {each: _visible(scenes, each, min_visible) for each in frames}
    targets: dict[FrameId, dict[int, int]] = {}
    try:
        for row in read_json(targets_file):
            frame = (int(row["scene_id"]), int(row["im_id"]))
            wanted = targets.setdefault(frame, {})
            if "obj_id" in row:
                wanted[int(row["obj_id"])] = int(row.get("inst_count", 1))
    except (KeyError, TypeError, AttributeError) as error:
        raise DataError(f"{targets_file} is no BOP targets file: {error!r}") from error
    for frame, wanted in targets.items():
        if not wanted or min_visible > 0:
            there = _visible(scenes, frame, min_visible)
            limit = wanted or there
            targets[frame] = {i: min(n, limit[i]) for i, n in there.items() if i in limit}
    return targets


def annotated_targets(scene: Scene, frame_id: int, where: str) -> list[Target]:
    """All annotated instances of a frame. Raises ValueError naming `where` for a broken pose."""
    entries = scene.truth(frame_id)
    visible = [float(info.get("visib_fract", "nan")) for info in scene.info(frame_id)]
    visible += [float("nan")] * (len(entries) - len(visible))
    return [
        Target(int(entry["obj_id"]), _pose(entry, where), fraction)
        for entry, fraction in zip(entries, visible, strict=False)
    ]


def most_visible(
    annotated: Sequence[Target], wanted: Mapping[int, int], where: str
) -> tuple[Target, ...]:
    """For each wanted object (id -> number) the most visible instances.

    Raises ValueError naming `where` if an object has fewer instances than wanted.
    """
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


def _visible(scenes: Mapping[int, Scene], frame: FrameId, min_visible: float) -> dict[int, int]:
    """Number of annotated instances of each object that are visible enough."""
    scene = scenes.get(frame[0])
    if scene is None:
        return {}
    entries, infos = scene.truth(frame[1]), scene.info(frame[1])
    infos += [{}] * (len(entries) - len(infos))
    return dict(
        Counter(
            int(entry["obj_id"])
            for entry, info in zip(entries, infos, strict=False)
            if not float(info.get("visib_fract", "nan")) < min_visible
        )
    )


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
