"""What a run writes into MLflow while it goes: numbers, parameters, files, images, tables."""

import json
import logging
import re
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from hlp.errors import MissingFileError
from hlp.reporting.mlflow_client import is_away

if TYPE_CHECKING:
    from mlflow import MlflowClient

LONGEST_VALUE = 6000  # characters of a parameter; MLflow's own limit, as are the next four
LONGEST_TAG = 5000
PARAMETERS_AT_ONCE = 100
METRICS_AT_ONCE = 1000
WIDEST_IMAGE = 800  # px
LONGEST_DIGEST = 36
_Answer = TypeVar("_Answer")
NOTE = "mlflow.note.content"  # tag of what MLflow shows as the description, in Markdown


@dataclass(frozen=True)
class LoggedAs:
    """Where a run is in MLflow."""

    client: "MlflowClient"
    experiment_id: str
    run_id: str


class Tracker:
    """One MLflow run, or none. In names, characters that MLflow refuses are replaced by `_`.

    Several threads may use it: their calls are sent one after another. `keep_aside` opens a run
    elsewhere that goes on when the server of this one is away.
    """

    def __init__(
        self, run: LoggedAs | None, keep_aside: Callable[[], LoggedAs] | None = None
    ) -> None:
        self._run = run
        self._keep_aside = keep_aside
        self._lock = threading.Lock()

    @property
    def run(self) -> LoggedAs | None:
        """Where the run is now; None without MLflow."""
        return self._run

    @property
    def run_id(self) -> str:
        """The run's id; empty without MLflow."""
        return "" if self._run is None else self._run.run_id

    @property
    def page_path(self) -> str:
        """Path of the run's page, to be appended to the address of MLflow's server."""
        return "" if self._run is None else run_page(self._run.experiment_id, self._run.run_id)

    def send(self, call: Callable[["MlflowClient", str], _Answer]) -> _Answer | None:
        """Let something be done or asked by the run's client and id; None without MLflow.

        If its server is away, the run goes on aside. Without one aside, raises MLflow's error.
        """
        if self._run is None:
            return None
        with self._lock:
            try:
                return call(self._run.client, self._run.run_id)
            except Exception as error:
                if self._keep_aside is None or not is_away(error):
                    raise
                self._run, self._keep_aside = self._keep_aside(), None
                logging.getLogger(__name__).warning(
                    "MLflow's server is away: the run goes on here; `hlp upload` sends it later"
                )
                return call(self._run.client, self._run.run_id)

    def log_metrics(self, metrics: Mapping[str, float | None], step: int = 0) -> None:
        """Log several numbers in one call, e.g. `add`; None (not measured) is left out."""
        if self._run is None:
            return
        from mlflow.entities import Metric

        now = int(time.time() * 1000)
        entries = [
            Metric(metric_name(name), float(value), now, step)
            for name, value in metrics.items()
            if value is not None
        ]
        self.send(lambda client, run_id: client.log_batch(run_id, metrics=entries))

    def log_curves(self, group: str, rows: Sequence[Mapping[str, float]]) -> None:
        """Log numbers of a training by epoch, as `<group>/<name>`, in one call."""
        if self._run is None:
            return
        from mlflow.entities import Metric

        now = int(time.time() * 1000)
        entries = [
            Metric(metric_name(f"{group}/{name}"), float(value), now, step)
            for step, row in enumerate(rows)
            for name, value in row.items()
        ]
        self._send_in_parts("metrics", entries, METRICS_AT_ONCE)

    def log_params(self, params: Mapping[str, Any]) -> None:
        """Log parameters; nested ones are flattened, long values are cut at MLflow's limit."""
        if self._run is None:
            return
        from mlflow.entities import Param

        entries = [
            Param(metric_name(name), str(value)[:LONGEST_VALUE])
            for name, value in flatten(params).items()
        ]
        self._send_in_parts("params", entries, PARAMETERS_AT_ONCE)

    def _send_in_parts(self, kind: str, entries: Sequence[Any], most: int) -> None:
        for start in range(0, len(entries), most):
            part = {kind: entries[start : start + most]}
            self.send(partial(_log_batch, part))

    def set_tags(self, tags: Mapping[str, str]) -> None:
        """Set tags in one call; long values are cut at MLflow's limit."""
        if self._run is None or not tags:
            return
        from mlflow.entities import RunTag

        entries = [RunTag(metric_name(k), v[:LONGEST_TAG]) for k, v in tags.items()]
        self.send(lambda client, run_id: client.log_batch(run_id, tags=entries))

    def describe(self, markdown: str) -> None:
        """Set the run's description."""
        self.set_tags({NOTE: markdown})

    def log_input(self, name: str, digest: str, source: str, context: str) -> None:
        """Log a data set that the run reads, with a `digest` of its content and its purpose."""
        if self._run is None:
            return
        from mlflow.entities import Dataset, DatasetInput, InputTag

        data = Dataset(name, digest[:LONGEST_DIGEST], "local", json.dumps({"uri": source}))
        inputs = [DatasetInput(data, [InputTag("mlflow.data.context", context)])]
        self.send(lambda client, run_id: client.log_inputs(run_id, datasets=inputs))

    def log_image(self, picture: Path, key: str, step: int) -> None:
        """Log a picture as the image of a step: MLflow shows those of one key beside each other.

        Raises MissingFileError if it does not exist.
        """
        if not picture.is_file():
            raise MissingFileError(f"no picture {picture} to log")
        if self._run is None:
            return
        from PIL import Image

        name = re.sub(r"[^\w\-. /]", "_", key, flags=re.ASCII)
        with Image.open(picture) as opened:
            image = opened.convert("RGB")
        image.thumbnail((WIDEST_IMAGE, image.height))  # MLflow keeps it as PNG
        self.send(lambda client, run_id: client.log_image(run_id, image, key=name, step=step))

    def log_artifact(self, path: Path, folder: str | None = None) -> None:
        """Copy a file into the run's artifacts. Raises MissingFileError if it does not exist."""
        if not path.is_file():
            raise MissingFileError(f"no file {path} to log")
        self.send(lambda client, run_id: client.log_artifact(run_id, str(path), folder))

    def log_artifacts(self, path: Path, folder: str | None = None) -> None:
        """Copy a folder's content into the run's artifacts, below `folder`.

        Raises MissingFileError if it does not exist.
        """
        if not path.is_dir():
            raise MissingFileError(f"no folder {path} to log")
        self.send(lambda client, run_id: client.log_artifacts(run_id, str(path), folder))

    def log_table(self, name: str, columns: Mapping[str, Sequence[Any]]) -> None:
        """Log a table, as `<name>.json`, which MLflow's pages show."""
        data = {column: list(values) for column, values in columns.items()}
        self.send(lambda client, run_id: client.log_table(run_id, data, f"{name}.json"))


def _log_batch(part: Mapping[str, Sequence[Any]], client: "MlflowClient", run_id: str) -> None:
    parts: dict[str, Any] = dict(part)
    client.log_batch(run_id, **parts)


def run_page(experiment_id: str, run_id: str) -> str:
    """Path of a run's page on MLflow's server."""
    return f"/#/experiments/{experiment_id}/runs/{run_id}?workflowType=machine_learning"


def metric_name(name: str) -> str:
    """The name with all characters that MLflow refuses (@, brackets, %, …) replaced by `_`."""
    return re.sub(r"[^\w\-. :/]", "_", name)


def flatten(nested: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    """Join the keys of nested mappings with dots: {"a": {"b": 1}} → {"a.b": 1}."""
    flat: dict[str, Any] = {}
    for key, value in nested.items():
        if isinstance(value, Mapping) and value:
            flat |= flatten(value, f"{prefix}{key}.")
        else:
            flat[f"{prefix}{key}"] = value
    return flat
