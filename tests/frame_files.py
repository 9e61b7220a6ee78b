"""Frames as files, as users have them."""

import json
from collections.abc import Collection, Sequence
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import ArrayLike

from hlp.data.synthetic.objects import demo_objects
from hlp.records import CameraImage, Frame, Target
from tiny_method import write_mesh


def write_image(
    folder: Path, name: str, image: CameraImage | Frame, units: float = 1000.0
) -> dict[str, str]:
    """The image as rgb/NAME.png and depth/NAME.png, with so many `units` a metre; both paths."""
    assert image.depth is not None
    paths = {kind: folder / kind / f"{name}.png" for kind in ("rgb", "depth")}
    for path in paths.values():
        path.parent.mkdir(parents=True, exist_ok=True)
    cv2.imwrite(str(paths["rgb"]), image.rgb[..., ::-1])
    cv2.imwrite(str(paths["depth"]), np.rint(image.depth * units).astype(np.uint16))
    return {kind: str(path) for kind, path in paths.items()}


def write_flat(
    folder: Path, name: str, color: ArrayLike, depth: int, shape: tuple[int, int] = (30, 40)
) -> None:
    """Images of one colour (RGB) and one raw depth: rgb/NAME, and depth/ as a PNG of its stem."""
    rgb = np.full((*shape, 3), color, np.uint8)
    paths = folder / "rgb" / name, (folder / "depth" / name).with_suffix(".png")
    for path, pixels in zip(paths, (rgb[..., ::-1], np.full(shape, depth, np.uint16)), strict=True):
        path.parent.mkdir(parents=True, exist_ok=True)
        cv2.imwrite(str(path), pixels)


def write_dpt(path: Path, raw: np.ndarray) -> None:
    """Depth as LINEMOD has it: rows and columns, then the values."""
    path.write_bytes(np.array(raw.shape, "<i4").tobytes() + raw.astype("<u2").tobytes())


def write_rows(path: Path, matrix: np.ndarray) -> None:
    """A matrix as LINEMOD has it: columns and rows, then the values."""
    rows = [" ".join(f"{value:.6f}" for value in row) for row in matrix]
    path.write_text("\n".join([f"{matrix.shape[1]} {matrix.shape[0]}", *rows, ""]))


def write_camera(folder: Path, frame: Frame, units: float = 1000.0) -> None:
    """The frame's camera as camera.json, which says what a unit of depth is."""
    (folder / "camera.json").write_text(json.dumps(camera_entry(frame, 1000.0 / units)))


def camera_entry(frame: Frame, depth_scale: float) -> dict[str, object]:
    """What BOP states of a frame's camera; a unit of depth is so many millimetres."""
    return {"cam_K": frame.camera_matrix.ravel().tolist(), "depth_scale": depth_scale}


def pose_entry(target: Target) -> dict[str, object]:
    """What BOP states of the pose of a target."""
    pose = target.pose_cam_obj
    return {
        "obj_id": target.object_id,
        "cam_R_m2c": pose[:3, :3].ravel().tolist(),
        "cam_t_m2c": (pose[:3, 3] * 1000).tolist(),
    }


def write_bop_set(root: Path, frames: Sequence[Frame], object_ids: Collection[int]) -> None:
    """Frames of the demo as a BOP set of one scene, in which these of its objects are annotated."""
    (root / "models").mkdir(parents=True)
    for object_id in object_ids:
        mesh = write_mesh(root / "models", demo_objects()[object_id])
        mesh.rename(mesh.with_name(f"obj_{object_id:06d}.ply"))
    scene = root / "test" / "000001"
    contents: dict[str, dict[int, object]] = {"camera": {}, "gt": {}, "gt_info": {}}
    for number, frame in enumerate(frames):
        write_image(scene, f"{number:06d}", frame, 10_000.0)
        chosen = [target for target in frame.targets if target.object_id in object_ids]
        contents["camera"][number] = camera_entry(frame, 0.1)
        contents["gt"][number] = [pose_entry(target) for target in chosen]
        contents["gt_info"][number] = [
            {"visib_fract": float(target.visible_fraction)} for target in chosen
        ]
    for name, content in contents.items():
        (scene / f"scene_{name}.json").write_text(json.dumps(content))
