"""Learnt objects behind MLflow's interface for models of any kind, `mlflow.pyfunc`.

    model = mlflow.pyfunc.load_model("models:/brackets/1")
    poses = model.predict({"rgb": rgb, "depth": depth, "camera_matrix": camera_matrix})

MLflow calls `_load_pyfunc` of the module that a model names; nothing here imports MLflow.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np

from hlp.errors import InputError
from hlp.geometry import rigid
from hlp.method.detector import Detector
from hlp.method.find.detections import plain
from hlp.records import CameraImage, ObjectModel
from hlp.rendering.rasterizer import render_scene
from hlp.rendering.shading import FRONTAL_LIGHT
from hlp.rendering.views import view_rotations

IMAGES = ("rgb", "depth", "camera_matrix")
_COLUMNS = ("object", "score", "pose_cam_obj", "visible_fraction", "seconds")


class PosesOfImages:
    """Poses of all learnt objects in RGB-D images."""

    def __init__(self, detector: Detector) -> None:
        self.detector = detector

    def predict(
        self, model_input: Mapping[str, np.ndarray], params: Mapping[str, Any] | None = None
    ) -> list[dict[str, Any]]:
        """A table of what was found: a row for each find, the most certain of an image first.

        `model_input` holds n images of one size: `rgb` (n, h, w, 3) uint8, `depth` (n, h, w) in
        metres, `camera_matrix` (n, 3, 3) in pixels. `params` are the options `objects`,
        `max_instances` and `min_score` of `Detector.detect`. A row has `image` (its index),
        `object`, `score`, `pose_cam_obj` (4×4, m), `visible_fraction` and `seconds`, ready for
        JSON. Raises InputError for numbers that differ; what is missing, MLflow names.
        """
        counts = {key: len(model_input[key]) for key in IMAGES}
        if len(set(counts.values())) > 1:
            raise InputError(f"each image has {', '.join(IMAGES)}: there are {counts}")
        images = zip(*(model_input[key] for key in IMAGES), strict=True)
        return [
            {"image": number} | {key: plain(getattr(found, key)) for key in _COLUMNS}
            for number, image in enumerate(images)
            for found in self.detector.detect(*image, **(params or {}))
        ]


def _load_pyfunc(path: str) -> PosesOfImages:
    """What `mlflow.pyfunc.load_model` calls with the folder of learnt objects."""
    return PosesOfImages(Detector.load(path))


_SHAPE = (120, 160)  # px: height, width
_FOCAL = 145.0  # px: a Kinect's, for a quarter of its resolution
_NEAREST = 0.4  # m
_FROM = (1.0, 0.6, 0.8)  # direction in the object's frame from which it is seen
_WALL = (178, 172, 160)


def example_image(model: ObjectModel) -> CameraImage:
    """An object in the air before a grey wall (120 × 160 px), seen obliquely from above.

    Its depth is in whole millimetres, as a camera delivers it.
    """
    height, width = _SHAPE
    camera_matrix = np.array([[_FOCAL, 0, width / 2], [0, _FOCAL, height / 2], [0, 0, 1.0]])
    distance = max(_NEAREST, 3.0 * model.diameter)
    rotation = view_rotations(np.array([_FROM]), np.zeros(1))[0]
    center = np.array([0.0, 0.0, distance])
    pose = rigid(rotation, center - rotation @ model.centroid)
    rgb, depth, index = render_scene([(model.mesh, pose)], camera_matrix, _SHAPE, FRONTAL_LIGHT)
    rgb[index < 0], depth[index < 0] = _WALL, distance + model.diameter
    return CameraImage(rgb, np.round(depth, 3).astype(np.float32), camera_matrix)
