"""Learnt objects as models in MLflow, by name."""

import tempfile
from collections.abc import Mapping
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from hlp.errors import ConfigError
from hlp.reporting.mlflow import import_client, reason
from hlp.reporting.mlflow.run import MlflowRun
from hlp.reporting.mlflow.tracking import MlflowSettings, track_run

if TYPE_CHECKING:
    from mlflow.models import ModelSignature

EXPERIMENT = "models"
_ABOUT = "Learnt objects, registered by `hlp objects register`."
_LOADER = "hlp.method.pyfunc_model"  # named, not imported: MLflow imports it when it loads a model


def register(
    learnt: Path, name: str, uri: str, options: Mapping[str, Any], example: Mapping[str, np.ndarray]
) -> str:
    """Copy a folder of learnt objects into MLflow as a new version of a model; its address.

    MLflow shows what the model takes and returns: `options` are those of a call with their
    defaults, `objects` the names of all objects that it knows; `example` is a call's input, which
    lies with the model. The address, e.g. `models:/brackets/2`, is for `mlflow.pyfunc.load_model`.
    Raises ConfigError if MLflow cannot be used or refuses the name.
    """
    import_client()
    from mlflow import pyfunc

    settings = MlflowSettings(uri=uri, experiment=EXPERIMENT, about=_ABOUT)
    tags = {"objects": ", ".join(options["objects"])}
    with tempfile.TemporaryDirectory() as folder, track_run(settings, name, {}, tags) as run:
        saved = Path(folder, "model")
        pyfunc.save_model(
            saved,
            loader_module=_LOADER,
            data_path=str(learnt),
            signature=_signature(options),
            input_example=dict(example),
            pip_requirements=[f"hlp=={version('hlp')}"],
        )
        run.log_artifacts(saved, "model")
        made = _add_version(run, name, tags)
    return f"models:/{name}/{made}"


def _add_version(run: MlflowRun, name: str, tags: Mapping[str, str]) -> str:
    """Register what lies in the run's artifacts as `model`; its version."""
    from mlflow.exceptions import MlflowException

    assert run.place is not None
    client, run_id = run.place.client, run.place.run_id
    source = f"{client.get_run(run_id).info.artifact_uri}/model"
    try:
        if not client.search_registered_models(f"name = '{name}'"):
            client.create_registered_model(name)
        return str(client.create_model_version(name, source, run_id, tags=dict(tags)).version)
    except MlflowException as error:
        raise ConfigError(f"MLflow cannot register {name}: {reason(error)}") from error


def _signature(options: Mapping[str, Any]) -> "ModelSignature":
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
    params = [
        ParamSpec("objects", DataType.string, list(options["objects"]), (-1,)),
        ParamSpec("max_instances", DataType.long, options["max_instances"]),
        ParamSpec("min_score", DataType.double, options["min_score"]),
    ]
    return ModelSignature(Schema(images), Schema(poses), ParamSchema(params))
