"""Learnt objects behind MLflow's interface for models of any kind, `mlflow.pyfunc`.

    model = mlflow.pyfunc.load_model("models:/brackets/1")
    poses = model.predict([{"rgb": rgb, "depth": depth, "camera_matrix": camera_matrix}])

MLflow calls `_load_pyfunc` of the module that a model names; nothing here imports MLflow.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from hlp.errors import InputError
from hlp.method.detections import Detection
from hlp.method.detector import Detector

_IMAGE = ("rgb", "depth", "camera_matrix")
_OPTIONS = ("objects", "max_instances", "min_score")


class PosesOfImages:
    """Poses of all learnt objects in RGB-D images."""

    def __init__(self, detector: Detector) -> None:
        self.detector = detector

    def predict(
        self, model_input: Sequence[Mapping[str, Any]], params: Mapping[str, Any] | None = None
    ) -> list[list[dict[str, Any]]]:
        """For each image a list of what was found, the most certain first.

        An image has `rgb` (h, w, 3; 0 to 255), `depth` (h, w; m) and `camera_matrix` (3, 3; px), as
        arrays or nested lists, and may have the options of `Detector.detect`: `objects`,
        `max_instances`, `min_score`. A find has `object`, `score`, `pose_cam_obj` (4×4, m),
        `visible_fraction` and `seconds`, ready for JSON. Raises InputError for an image that lacks
        something or has something unknown. `params` is what MLflow calls with; there are none.
        """
        return [self._predict_one(image) for image in model_input]

    def _predict_one(self, image: Mapping[str, Any]) -> list[dict[str, Any]]:
        missing = [key for key in _IMAGE if not isinstance(image, Mapping) or key not in image]
        if missing:
            raise InputError(f"an image has {', '.join(_IMAGE)}: {missing[0]} is missing")
        options = {key: value for key, value in image.items() if key not in _IMAGE}
        if unknown := set(options) - set(_OPTIONS):
            raise InputError(f"{min(unknown)} is no option: there are {', '.join(_OPTIONS)}")
        found = self.detector.detect(
            np.asarray(image["rgb"], dtype=np.uint8),
            np.asarray(image["depth"], dtype=np.float64),
            np.asarray(image["camera_matrix"], dtype=np.float64),
            **options,
        )
        return [_plain(each) for each in found]


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
