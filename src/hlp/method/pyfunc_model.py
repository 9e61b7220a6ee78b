"""Learnt objects behind MLflow's interface for models of any kind, `mlflow.pyfunc`.

    model = mlflow.pyfunc.load_model("models:/brackets/1")
    poses = model.predict({"rgb": rgb, "depth": depth, "camera_matrix": camera_matrix})

MLflow calls `_load_pyfunc` of the module that a model names; nothing here imports MLflow.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np

from hlp.errors import InputError
from hlp.method.detector import Detector
from hlp.method.find.detections import Detection

_IMAGES = ("rgb", "depth", "camera_matrix")


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
        JSON. Raises InputError naming what is missing or wrong.
        """
        for key in _IMAGES:
            if key not in model_input:
                raise InputError(f"images have {', '.join(_IMAGES)}: {key} is missing")
        counts = {key: len(model_input[key]) for key in _IMAGES}
        if len(set(counts.values())) > 1:
            raise InputError(f"each image has {', '.join(_IMAGES)}: there are {counts}")
        images = zip(*(model_input[key] for key in _IMAGES), strict=True)
        return [
            {"image": number, **_plain(found)}
            for number, image in enumerate(images)
            for found in self.detector.detect(*image, **(params or {}))
        ]


def _plain(detection: Detection) -> dict[str, Any]:
    return {
        "object": detection.object,
        "score": float(detection.score),
        "pose_cam_obj": detection.pose_cam_obj.tolist(),
        "visible_fraction": float(detection.visible_fraction),
        "seconds": float(detection.seconds),
    }


def _load_pyfunc(path: str) -> PosesOfImages:
    """What `mlflow.pyfunc.load_model` calls with the folder of learnt objects."""
    return PosesOfImages(Detector.load(path))
