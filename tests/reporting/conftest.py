"""A database of MLflow for all tests of this folder: making one takes seconds."""

import pytest

from hlp.reporting.mlflow_tracking import MlflowSettings


@pytest.fixture(scope="session")
def mlflow_settings(tmp_path_factory: pytest.TempPathFactory) -> MlflowSettings:
    uri = f"sqlite:///{tmp_path_factory.mktemp('tracking') / 'deep' / 'mlflow.db'}"
    return MlflowSettings(uri=uri, experiment="hlp")
