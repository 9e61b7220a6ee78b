"""A small data set in BOP's layout, written by hand: one scene, two frames, objects 1 and 6."""

import json
from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np
import trimesh

K = [500.0, 0, 40, 0, 510.0, 30, 0, 0, 1]
FRAMES = {0: [(1, 0.9), (6, 0.2), (6, 0.7)], 12: [(1, 0.05)]}
"""Frame -> object and visible fraction of each annotated instance."""


def write_scene(split: Path, color: str = "rgb/png", scene: int = 6) -> Path:
    """A scene in BOP's classic layout; `color` is the folder and extension of colour images."""
    folder, (kind, extension) = split / f"{scene:06d}", color.split("/")
    for name in (kind, "depth", "mask_visib"):
        (folder / name).mkdir(parents=True)
    rng = np.random.default_rng(scene)
    cameras, truths, infos = {}, {}, {}
    for frame, instances in FRAMES.items():
        shape = (60, 80, 3) if kind == "rgb" else (60, 80)
        image = rng.integers(0, 256, shape).astype(np.uint8)
        cv2.imwrite(str(folder / kind / f"{frame:06d}.{extension}"), image)
        depth = rng.integers(6000, 9000, (60, 80)).astype(np.uint16)
        cv2.imwrite(str(folder / "depth" / f"{frame:06d}.png"), depth)
        cameras[str(frame)] = {"cam_K": K, "depth_scale": 0.1}
        truths[str(frame)] = [_entry(i, 10.0 * n) for n, (i, _) in enumerate(instances)]
        infos[str(frame)] = [{"visib_fract": fraction} for _, fraction in instances]
        for number in range(len(instances)):
            mask = (rng.random((60, 80)) < 0.3).astype(np.uint8) * 255
            cv2.imwrite(str(folder / "mask_visib" / f"{frame:06d}_{number:06d}.png"), mask)
    for name, content in (("camera", cameras), ("gt", truths), ("gt_info", infos)):
        (folder / f"scene_{name}.json").write_text(json.dumps(content))
    return folder


def write_models(folder: Path, object_ids: Sequence[int], side_mm: float = 80.0) -> None:
    """Boxes in millimetres, without models_info.json."""
    folder.mkdir(parents=True)
    for object_id in object_ids:
        box = trimesh.creation.box((side_mm, side_mm + 10, side_mm + 20))
        (folder / f"obj_{object_id:06d}.ply").write_bytes(box.export(file_type="ply"))


def write_targets(path: Path, rows: Sequence[tuple[int, ...]]) -> None:
    """A list of targets: (scene, frame, object, instances), or (scene, frame) alone."""
    keys = ("scene_id", "im_id", "obj_id", "inst_count")
    path.write_text(json.dumps([dict(zip(keys, row, strict=False)) for row in rows]))


def _entry(object_id: int, x: float) -> dict[str, object]:
    return {"obj_id": object_id, "cam_R_m2c": np.eye(3).ravel().tolist(), "cam_t_m2c": [x, 0, 700]}
