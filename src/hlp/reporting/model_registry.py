"""Learnt objects as models in MLflow, by name."""

import tempfile
from collections.abc import Mapping
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from hlp.errors import ConfigError
from hlp.records import CameraImage
from hlp.reporting.experiment_page import ExperimentPage
from hlp.reporting.mlflow_client import connect, import_client, reason
from hlp.reporting.tracking import TrackingSettings, track_run

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


EXPERIMENT = "models"
_ABOUT = "Learnt objects, registered by `hlp objects register`."
_LOADER = "hlp.method.pyfunc_model"  # named, not imported: MLflow imports it when it loads a model


def register(
    learnt: Path, name: str, uri: str, tags: Mapping[str, str], model_input: ModelInput
) -> str:
    """Copy a folder of learnt objects into MLflow as a new version of a model; its address.

    MLflow shows what the model takes and returns, with an example. The address, e.g.
    `models:/brackets/2`, is for `mlflow.pyfunc.load_model`. Raises ConfigError if MLflow cannot be
    used or refuses the name.
    """
    import_client()
    from mlflow import pyfunc
    from mlflow.exceptions import MlflowException

    settings = TrackingSettings(uri=uri, experiment=EXPERIMENT, about=_ABOUT)
    client = connect(uri, EXPERIMENT, ExperimentPage(_ABOUT).tags, settings.unsent).client
    with (
        tempfile.TemporaryDirectory() as folder,
        track_run(settings, name, {}, tags) as tracker,
    ):
        saved = Path(folder, "model")
        pyfunc.save_model(
            saved,
            loader_module=_LOADER,
            data_path=str(learnt),
            signature=model_signature(model_input),
            input_example=model_input.images,
            pip_requirements=[f"hlp=={version('hlp')}"],
        )
        tracker.log_artifacts(saved, "model")
        run = client.get_run(tracker.run_id)
        source = f"{run.info.artifact_uri}/model"
        try:
            if not client.search_registered_models(f"name = '{name}'"):
                client.create_registered_model(name)
            made = client.create_model_version(name, source, tracker.run_id, tags=dict(tags))
        except MlflowException as error:
            raise ConfigError(f"MLflow cannot register {name}: {reason(error)}") from error
    return f"models:/{name}/{made.version}"
