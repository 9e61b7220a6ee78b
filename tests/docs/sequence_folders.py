"""Frames of one object in the layouts of LINEMOD and YCBInEOAT."""

from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np

from frame_files import write_dpt, write_image, write_rows
from hlp.records import Frame, ObjectModel
from tiny_method import export_mesh


def write_linemod(root: Path, model: ObjectModel, frames: Sequence[Frame]) -> None:
    """The object as LINEMOD's ape: mesh, colour, depth in millimetres, poses in centimetres."""
    data = root / "ape" / "data"
    data.mkdir(parents=True)
    export_mesh(data.parent / "mesh.ply", model)
    for number, frame in enumerate(frames):
        cv2.imwrite(str(data / f"color{number}.jpg"), frame.rgb[..., ::-1])
        write_dpt(data / f"depth{number}.dpt", np.rint(frame.depth * 1000))
        pose = pose_of(model, frame)
        write_rows(data / f"rot{number}.rot", pose[:3, :3])
        write_rows(data / f"tra{number}.tra", pose[:3, 3:] * 100.0)


def write_ycbineoat(root: Path, model: ObjectModel, frames: Sequence[Frame]) -> None:
    """Colour, depth in millimetres, poses in metres and the camera."""
    (root / "annotated_poses").mkdir(parents=True)
    for number, frame in enumerate(frames):
        write_image(root, f"{number:07d}", frame)
        np.savetxt(root / "annotated_poses" / f"{number:07d}.txt", pose_of(model, frame))
        np.savetxt(root / "cam_K.txt", frame.camera_matrix)


def pose_of(model: ObjectModel, frame: Frame) -> np.ndarray:
    """The pose of the first instance."""
    return next(x.pose_cam_obj for x in frame.targets if x.object_id == model.object_id)
