"""Where MLflow's runs are, for the commands that compose no configuration."""

import os


def tracking_uri(work: str = "work") -> str:
    """MLflow's own variable MLFLOW_TRACKING_URI, or the database in the folder `work`."""
    return os.environ.get("MLFLOW_TRACKING_URI") or f"sqlite:///{work}/mlflow.db"
