"""Learnt objects as models in MLflow, by name."""

import tempfile
from collections.abc import Mapping
from importlib.metadata import version
from pathlib import Path

from hlp.errors import ConfigError
from hlp.reporting.experiment_page import ExperimentPage
from hlp.reporting.mlflow_client import connect, import_client, reason
from hlp.reporting.model_signature import ModelInput, model_signature
from hlp.reporting.tracking import TrackingSettings, track_run

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
