"""Makes the example beside it: one of the demo's objects, learnt alone, and a frame that shows it.

    python docs/example/make.py FOLDER

FOLDER must not exist; a few minutes later it holds learnt/, rgb.png, depth.png and camera.json.
"""

import sys
from pathlib import Path

import cv2
import numpy as np
import trimesh

from hlp import Detector
from hlp.commands.composing import compose_config
from hlp.config.build import build_run
from hlp.files import write_json

OBJECT = "drill"
FRAME = 3
"""Of the demo's frames: the object is partly hidden."""


def main(folder: Path) -> None:
    """Write the frame, then learn the object."""
    folder.mkdir(parents=True)
    dataset = build_run(compose_config()).dataset
    frame = dataset.frames.load(dataset.frames.keys[FRAME])
    cv2.imwrite(str(folder / "rgb.png"), frame.rgb[..., ::-1])
    cv2.imwrite(str(folder / "depth.png"), np.rint(1000.0 * frame.depth).astype(np.uint16))
    camera = {"cam_K": frame.camera_matrix.ravel().tolist(), "depth_scale": 1.0}
    write_json(folder / "camera.json", camera)
    mesh = next(model.mesh for model in dataset.models.values() if model.name == OBJECT)
    shape = trimesh.Trimesh(1000.0 * mesh.vertices, mesh.faces, process=False)
    shape.visual.vertex_colors = mesh.colors
    shape.export(folder / f"{OBJECT}.ply")
    Detector.learn({OBJECT: folder / f"{OBJECT}.ply"}, folder / "learnt", mesh_scale=0.001)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
