"""What MLflow shows first of an experiment: a description, and the columns that one compares."""

import json
from dataclasses import dataclass

from hlp.reporting.mlflow_metrics import HEADLINES
from hlp.reporting.tracker import NOTE

_VIEW = "hlp"  # name of the shared view, which links to the page ask for
_KIND = "mlflow.experimentKind"  # otherwise MLflow opens its pages for language models
_VIEW_TAG = f"mlflow.sharedViewState.{_VIEW}"
# MLflow sorts metrics by name and cuts names of runs off; these fit a window of 1440 px, also with
# its assistant beside them.
_NAME = "attributes.`Run Name`"
_WIDTHS = {"add": 75, "5cm5deg": 95, "iou50": 80, "ms": 75}  # px
_OTHERS = {"runDateAndNestInfo": 150, "duration": 85}


@dataclass(frozen=True)
class ExperimentPage:
    """What an experiment is in words, the command that makes a run of it, and the data set."""

    about: str = ""
    command: str = ""
    data: str = ""

    @property
    def tags(self) -> dict[str, str]:
        """The tags that MLflow reads when it shows the experiment."""
        lines = [self.about]
        if self.command:
            lines.append(f"Command: `{self.command}`")
        if self.data:
            lines.append(f"Data of the first run: {self.data}")
        description = "\n\n".join(line for line in lines if line)
        tags = {_KIND: "custom_model_development", _VIEW_TAG: _headline_columns()}
        return {**tags, NOTE: description} if description else tags


def _headline_columns() -> str:
    """The shared view: the names of runs in full, then the headline metrics, as columns."""
    metrics = {f"metrics.`{name}`": _WIDTHS[name] for name in HEADLINES}
    widths = {_NAME: 270, **metrics, **_OTHERS}
    shown = {"selectedColumns": [*metrics], "columnOrder": [*widths], "columnWidths": widths}
    return json.dumps(shown)


def experiment_path(experiment_id: str) -> str:
    """Path of an experiment's list of runs on MLflow's server, with the columns chosen above."""
    asked = f"workflowType=machine_learning&viewStateShareKey={_VIEW}"
    return f"/#/experiments/{experiment_id}/runs?{asked}"
