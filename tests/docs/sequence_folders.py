"""Frames of one object in the layouts of LINEMOD and YCBInEOAT."""

from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np

from hlp.records import Frame, ObjectModel
from tiny_method import export_mesh


def write_linemod(root: Path, model: ObjectModel, frames: Sequence[Frame]) -> None:
    """The object as LINEMOD's ape: mesh, colour, depth in millimetres, poses in centimetres."""
    data = root / "ape" / "data"
    data.mkdir(parents=True)
    export_mesh(data.parent / "mesh.ply", model)
    for number, frame in enumerate(frames):
        cv2.imwrite(str(data / f"color{number}.jpg"), frame.rgb[..., ::-1])
        raw = np.rint(frame.depth * 1000).astype("<u2")
        shape = np.array(raw.shape, "<i4")
        (data / f"depth{number}.dpt").write_bytes(shape.tobytes() + raw.tobytes())
        pose = pose_of(model, frame)
        _write_rows(data / f"rot{number}.rot", pose[:3, :3])
        _write_rows(data / f"tra{number}.tra", pose[:3, 3:] * 100.0)


def write_ycbineoat(root: Path, model: ObjectModel, frames: Sequence[Frame]) -> None:
    """Colour, depth in millimetres, poses in metres and the camera."""
    for name in ("rgb", "depth", "annotated_poses"):
        (root / name).mkdir(parents=True)
    for number, frame in enumerate(frames):
        cv2.imwrite(str(root / "rgb" / f"{number:07d}.png"), frame.rgb[..., ::-1])
        raw = np.rint(frame.depth * 1000).astype(np.uint16)
        cv2.imwrite(str(root / "depth" / f"{number:07d}.png"), raw)
        np.savetxt(root / "annotated_poses" / f"{number:07d}.txt", pose_of(model, frame))
        np.savetxt(root / "cam_K.txt", frame.camera_matrix)


def pose_of(model: ObjectModel, frame: Frame) -> np.ndarray:
    """The pose of the first instance."""
    return next(x.pose_cam_obj for x in frame.targets if x.object_id == model.object_id)


def _write_rows(path: Path, matrix: np.ndarray) -> None:
    rows = [" ".join(f"{value:.6f}" for value in row) for row in matrix]
    path.write_text("\n".join([f"{matrix.shape[1]} {matrix.shape[0]}", *rows, ""]))
