"""MLflow is imported before HLP could tell it to send nothing."""

import os

os.environ.setdefault("MLFLOW_DISABLE_TELEMETRY", "true")
