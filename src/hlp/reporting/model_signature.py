"""What a registered model takes and returns, as MLflow checks it and shows it on its page."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from hlp.records import CameraImage

if TYPE_CHECKING:
    from mlflow.models import ModelSignature


@dataclass(frozen=True)
class ModelInput:
    """What a model is called with: its options' defaults, and an image as example.

    `objects` are the names of all objects it knows.
    """

    objects: tuple[str, ...]
    max_instances: int
    min_score: float
    example: CameraImage

    @property
    def images(self) -> dict[str, np.ndarray]:
        """The example as n = 1 images: rgb (n, h, w, 3), depth (n, h, w), matrix (n, 3, 3)."""
        image = self.example
        return {
            "rgb": image.rgb[None],
            "depth": image.depth[None].astype(np.float32),
            "camera_matrix": image.camera_matrix[None],
        }


def model_signature(given: ModelInput) -> "ModelSignature":
    """Images in, a table of poses out.

    Images are tensors: of nested lists, MLflow would look at each number by itself, which takes far
    longer than the detection.
    """
    from mlflow.models import ModelSignature
    from mlflow.types import ColSpec, DataType, ParamSchema, ParamSpec, Schema, TensorSpec
    from mlflow.types.schema import Array

    images: list[ColSpec | TensorSpec] = [
        TensorSpec(np.dtype(np.uint8), (-1, -1, -1, 3), "rgb"),
        TensorSpec(np.dtype(np.float32), (-1, -1, -1), "depth"),
        TensorSpec(np.dtype(np.float64), (-1, 3, 3), "camera_matrix"),
    ]
    poses: list[ColSpec | TensorSpec] = [
        ColSpec(DataType.long, "image"),
        ColSpec(DataType.string, "object"),
        ColSpec(DataType.double, "score"),
        ColSpec(Array(Array(DataType.double)), "pose_cam_obj"),
        ColSpec(DataType.double, "visible_fraction"),
        ColSpec(DataType.double, "seconds"),
    ]
    options = [
        ParamSpec("objects", DataType.string, list(given.objects), (-1,)),
        ParamSpec("max_instances", DataType.long, given.max_instances),
        ParamSpec("min_score", DataType.double, given.min_score),
    ]
    return ModelSignature(Schema(images), Schema(poses), ParamSchema(options))
