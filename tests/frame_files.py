"""Frames as files, as users have them."""

import json
from pathlib import Path

import cv2
import numpy as np

from hlp.records import CameraImage, Frame


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


def write_camera(folder: Path, frame: Frame, units: float = 1000.0) -> None:
    """The frame's camera as camera.json, which says what a unit of depth is."""
    camera = {"cam_K": frame.camera_matrix.ravel().tolist(), "depth_scale": 1000.0 / units}
    (folder / "camera.json").write_text(json.dumps(camera))
