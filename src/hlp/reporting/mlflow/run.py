"""What a run writes into MLflow while it goes: numbers, parameters, files, images."""

import json
import logging
import re
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from hlp.reporting.mlflow import is_unreachable, reason
from hlp.reporting.mlflow.pages import NOTE, run_path

if TYPE_CHECKING:
    from mlflow import MlflowClient

# MLflow's own limits.
_LONGEST_VALUE, _LONGEST_TAG, _LONGEST_DIGEST = 6000, 5000, 36  # characters
_AT_ONCE = {"metrics": 1000, "params": 100, "tags": 100}
_WIDEST_IMAGE = 800  # px
_INTERVAL = 10.0  # s between two system metrics, as MLflow's own
_STATUS = Path("/proc/self/status")
_Answer = TypeVar("_Answer")


@dataclass(frozen=True)
class LoggedAs:
    """Where a run is in MLflow."""

    client: "MlflowClient"
    experiment_id: str
    run_id: str


class MlflowRun:
    """One MLflow run, or none: `place` is where it is now, None without MLflow.

    In names, characters that MLflow refuses are replaced by `_`. Several threads may use it: their
    calls are sent one after another. `keep_aside` opens a run elsewhere that goes on when the
    server of this one is unreachable.
    """

    def __init__(
        self, place: LoggedAs | None, keep_aside: Callable[[], LoggedAs] | None = None
    ) -> None:
        self.place = place
        self._keep_aside = keep_aside
        self._lock = threading.Lock()

    @property
    def run_id(self) -> str:
        """The run's id; empty without MLflow."""
        return "" if self.place is None else self.place.run_id

    @property
    def page_path(self) -> str:
        """Path of the run's page on MLflow's server; empty without MLflow."""
        return "" if self.place is None else run_path(self.place.experiment_id, self.run_id)

    def send(self, call: Callable[["MlflowClient", str], _Answer]) -> _Answer | None:
        """Let something be done or asked by the run's client and id; None without MLflow.

        If its server is unreachable, the run goes on aside; without one aside, the error is raised.
        """
        if self.place is None:
            return None
        with self._lock:
            try:
                return call(self.place.client, self.place.run_id)
            except Exception as error:
                if self._keep_aside is None or not is_unreachable(error):
                    raise
                self.place, self._keep_aside = self._keep_aside(), None
                logging.getLogger(__name__).warning(
                    "MLflow's server is unreachable: it goes on here, `hlp upload` sends it later"
                )
                return call(self.place.client, self.place.run_id)

    def log_entities(self, kind: str, fields: Iterable[tuple[Any, ...]]) -> None:
        """Log `metrics`, `params` or `tags`, given the fields of each of MLflow's entities."""
        if self.place is None:
            return
        from mlflow import entities

        of = {"metrics": entities.Metric, "params": entities.Param, "tags": entities.RunTag}
        made = [of[kind](*own) for own in fields]
        for start in range(0, len(made), _AT_ONCE[kind]):
            part = {kind: made[start : start + _AT_ONCE[kind]]}
            self.send(partial(_log_batch, part))

    def log_metrics(self, metrics: Mapping[str, float | None], step: int = 0) -> None:
        """Log several numbers in one call, e.g. `add`; None (not measured) is left out."""
        known = {name: value for name, value in metrics.items() if value is not None}
        self._log_numbers((name, value, step) for name, value in known.items())

    def _log_numbers(self, numbers: Iterable[tuple[str, float, int]]) -> None:
        now = int(time.time() * 1000)
        fields = ((metric_name(name), float(value), now, step) for name, value, step in numbers)
        self.log_entities("metrics", fields)

    def log_training(
        self, stage: str, fingerprint: str, rows: Sequence[Mapping[str, float]]
    ) -> str:
        """Log the numbers of a training by epoch, as `stage/name`, unless an earlier run has them.

        Returns what to say in the run's description: a link to that run; empty if this is the one.
        """
        if not rows:
            return ""
        tag = f"trained.{stage}"
        found = self.send(lambda client, _: _run_with(client, tag, fingerprint))
        if found is None:
            epochs = enumerate(rows)
            numbers = ((f"{stage}/{name}", v, i) for i, row in epochs for name, v in row.items())
            self._log_numbers(numbers)
            self.set_tags({tag: fingerprint})
            return ""
        if found.run_id == self.run_id:
            return ""
        self.set_tags({f"{stage}_of_run": found.run_id})
        page = run_path(found.experiment_id, found.run_id)[1:]
        return f"{stage} trained by [{found.run_name}]({page})"

    def log_params(self, params: Mapping[str, Any]) -> None:
        """Log parameters; long values are cut at MLflow's limit."""
        cut = ((metric_name(name), str(value)[:_LONGEST_VALUE]) for name, value in params.items())
        self.log_entities("params", cut)

    def set_tags(self, tags: Mapping[str, str]) -> None:
        """Set tags; long values are cut at MLflow's limit."""
        self.log_entities("tags", ((metric_name(k), v[:_LONGEST_TAG]) for k, v in tags.items()))

    def describe(self, markdown: str) -> None:
        """Set the run's description, after its first paragraph a link to the page's better view.

        A click in the list of runs opens the page with MLflow's menu for language models.
        """
        first, *rest = markdown.split("\n\n", 1)
        view = f"[This page with the menu of model training]({self.page_path[1:]})"
        self.set_tags({NOTE: "\n\n".join([first, view, *rest])})

    def log_input(self, name: str, digest: str, source: str, context: str) -> None:
        """Log a data set that the run reads, with a `digest` of its content and its purpose."""
        if self.place is None:
            return
        from mlflow.entities import Dataset, DatasetInput, InputTag

        data = Dataset(name, digest[:_LONGEST_DIGEST], "local", json.dumps({"uri": source}))
        inputs = [DatasetInput(data, [InputTag("mlflow.data.context", context)])]
        self.send(lambda client, run_id: client.log_inputs(run_id, datasets=inputs))

    def log_image(self, picture: Path, key: str, step: int) -> None:
        """Log a picture as the image of a step: MLflow shows those of one key beside each other."""
        if self.place is None:
            return
        from PIL import Image

        name = re.sub(r"[^\w\-. /]", "_", key, flags=re.ASCII)
        with Image.open(picture) as opened:
            image = opened.convert("RGB")
        image.thumbnail((_WIDEST_IMAGE, image.height))  # MLflow keeps it as PNG
        self.send(lambda client, run_id: client.log_image(run_id, image, key=name, step=step))

    def log_artifact(self, path: Path) -> None:
        """Copy a file into the run's artifacts."""
        self.send(lambda client, run_id: client.log_artifact(run_id, str(path)))

    def log_artifacts(self, path: Path, folder: str | None = None) -> None:
        """Copy a folder's content into the run's artifacts, below `folder`."""
        self.send(lambda client, run_id: client.log_artifacts(run_id, str(path), folder))

    @contextmanager
    def system_metrics(self, interval: float = _INTERVAL) -> Iterator[None]:
        """Log cores in use and memory (MB) of this process while the block runs, and at its end.

        MLflow's own would need psutil, and are those of the whole machine, whoever else uses it. A
        step is a second since the run began, also in a run that goes on. CPU time (s) and the
        largest memory (MB) of the whole block follow at the end, unless it fails. No thread is
        started without MLflow.
        """
        if self.place is None:
            yield
            return
        begun, ended = time.process_time(), threading.Event()
        sampler = threading.Thread(
            target=self._sample, args=(interval, ended), name="system metrics", daemon=True
        )
        sampler.start()
        try:
            yield
        finally:
            ended.set()
            sampler.join()
        spent = time.process_time() - begun
        peak = _memory("VmHWM")
        self.log_metrics({"system/cpu_seconds": spent, "system/peak_memory_megabytes": peak})

    def _sample(self, interval: float, ended: threading.Event) -> None:
        """Log what was used since the last time, until the block has ended."""
        try:
            began = self.send(lambda client, run_id: client.get_run(run_id).info.start_time) or 0
            clock, spent, last = time.time(), time.process_time(), False
            while not last:
                last = ended.wait(interval)
                now, used = time.time(), time.process_time()
                cores = (used - spent) / max(now - clock, 1e-3)
                clock, spent = now, used
                values = {"system/cpu_cores": cores, "system/memory_megabytes": _memory("VmRSS")}
                self.log_metrics(values, max(0, int(now - began / 1000)))
        except Exception as error:  # the run's own next call says what is wrong
            logging.getLogger(__name__).warning("no more system metrics: %s", reason(error))


def _log_batch(part: dict[str, Any], client: "MlflowClient", run_id: str) -> None:
    client.log_batch(run_id, **part)


def _run_with(client: "MlflowClient", tag: str, value: str) -> Any:
    """MLflow's `RunInfo` of the first run with this tag, or None."""
    found = client.search_runs(
        [experiment.experiment_id for experiment in client.search_experiments()],
        f"tags.`{tag}` = '{value}'",
        order_by=["attributes.start_time ASC"],
        max_results=1,
    )
    return found[0].info if found else None


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


def _memory(field: str) -> float | None:
    """Memory of this process in MB: `VmRSS` (now) or `VmHWM` (the largest so far), on Linux."""
    lines = _STATUS.read_text().splitlines() if _STATUS.is_file() else []
    sizes = [int(line.split()[1]) for line in lines if line.startswith(field)]
    return sizes[0] * 1024 / 1e6 if sizes else None
