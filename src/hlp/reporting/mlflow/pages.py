"""What MLflow's pages show of runs: names, descriptions, columns, metrics; and their server."""

import json
import os
import shlex
import socket
import subprocess
import sys
import time
from collections.abc import Collection, Iterator, Mapping
from contextlib import contextmanager, suppress
from typing import Any
from urllib.request import urlopen

from hlp.errors import InputError, MissingFileError, NetworkError
from hlp.reporting.mlflow import (
    SQLITE,
    VIEWS,
    artifacts_uri,
    database_path,
    import_client,
    is_local,
    prepare_database,
)

NOTE = "mlflow.note.content"  # tag of what MLflow shows as the description, in Markdown
_KIND = "mlflow.experimentKind"  # otherwise MLflow opens its pages for language models
_VIEW = "hlp"  # name of the shared view, which links to the page ask for
HEADLINES = ("add", "5cm5deg", "iou50", "ms", "targets", "frames")
"""The numbers that one compares first. All others have names with a group: `time_ms/total`."""
_RECALLS = HEADLINES[:3]
# MLflow sorts metrics by name and cuts names of runs off; names and the first three metrics fit a
# window of 1440 px with its assistant: a recall is seen beside what it was measured on.
_WIDTHS = {
    "attributes.`Run Name`": 270,
    "metrics.`add`": 75,
    "metrics.`targets`": 80,
    "metrics.`frames`": 75,
    "metrics.`ms`": 75,
    "metrics.`5cm5deg`": 95,
    "metrics.`iou50`": 80,
    "runDateAndNestInfo": 150,
    "duration": 85,
}  # px
_LONGEST = 48  # characters of a name; MLflow's columns cut longer ones off
_UNNAMED = {"data.root", "data_folder", "panels", "timing_frames", "on_bad_frame"}
_UNNAMED_GROUPS = ("reporting", "machine", "executor")
_HOST, PORT = "127.0.0.1", 5000
_LONGEST_START, _SHUTDOWN = 300, 10  # s


def short_name(values: Mapping[str, str], groups: Collection[str], otherwise: str) -> str:
    """Values in words: `icp, particles 25, seed 1`; of a group, its alternative alone.

    What changes no pose or is shown elsewhere is left out; `otherwise` where nothing is left.
    """
    words = []
    for key, value in values.items():
        if key not in _UNNAMED and key.partition(".")[0] not in _UNNAMED_GROUPS:
            last = key.rpartition(".")[2].rpartition("/")[2]
            words.append(value if key in groups else f"{last} {value}")
    name = ", ".join(words) or otherwise
    return name if len(name) <= _LONGEST else f"{name[: _LONGEST - 1]}…"


def experiment_tags(about: str = "", command: str = "", data: str = "") -> dict[str, str]:
    """The tags that MLflow reads when it shows an experiment.

    They say in words what it is, the command that makes a run of it, and the data set; and that the
    list of runs shows the headline metrics as columns, and names in full.
    """
    lines = about, command and f"Command: `{command}`", data and f"Data of the first run: {data}"
    view = {
        "selectedColumns": [name for name in _WIDTHS if name.startswith("metrics.")],
        "columnOrder": [*_WIDTHS],
        "columnWidths": _WIDTHS,
    }
    tags = {_KIND: "custom_model_development", f"{VIEWS}{_VIEW}": json.dumps(view)}
    description = "\n\n".join(filter(None, lines))
    return {**tags, NOTE: description} if description else tags


def experiment_path(experiment_id: str) -> str:
    """Path of an experiment's list of runs on MLflow's server, with the columns chosen above."""
    asked = f"workflowType=machine_learning&viewStateShareKey={_VIEW}"
    return f"/#/experiments/{experiment_id}/runs?{asked}"


def run_path(experiment_id: str, run_id: str) -> str:
    """Path of a run's page on MLflow's server."""
    return f"/#/experiments/{experiment_id}/runs/{run_id}?workflowType=machine_learning"


def summary_metrics(summary: Mapping[str, Any]) -> dict[str, float | None]:
    """Numbers of `summary.json` by name, e.g. `add`, `add_by_object/cat`, `time_ms/voting`.

    None where nothing was measured.
    """
    flat = headline_metrics(summary)
    for key in _RECALLS:
        metric = summary["metrics"][key]
        low, high = metric["ci95"]
        flat |= {f"ci95/{key}_low": low, f"ci95/{key}_high": high}
        flat[f"mean_object/{key}"] = metric["mean_object"]
        for name, scores in summary["per_object"].items():
            flat[f"{key}_by_object/{name}"] = scores[key]["recall"]
    for stage, times in summary["timing_ms"].items():
        flat |= {f"time_ms/{stage}": times["median"], f"time_ms/{stage}_p95": times["p95"]}
    votes = summary["votes"]
    for name, shares in votes["per_object"].items():
        flat[f"votes_by_object/good_{name}"] = shares["good"]
        flat[f"votes_by_object/good_by_object_{name}"] = shares["good_by_object"]
    groups = {
        "votes": votes["total"],
        "waterfall": summary["waterfall"]["total"],
        "calibration": {name: summary["calibration"][name] for name in ("ece", "aurc")},
        "median_errors": summary["median_errors"],
        "bop": summary["bop"],
    }
    for group, values in groups.items():
        flat |= {f"{group}/{name}": value for name, value in values.items()}
    return flat


def headline_metrics(summary: Mapping[str, Any]) -> dict[str, float | None]:
    """Recalls, median time (ms, of one object in one frame), targets and frames of `summary.json`.

    Rounded, since MLflow's columns would show `0.943661…`.
    """
    values = {key: summary["metrics"][key]["recall"] for key in _RECALLS}
    values["ms"] = summary["timing_ms"]["total"]["median"]
    rounded = {k: v if v is None else round(v, 1 if k == "ms" else 4) for k, v in values.items()}
    return rounded | {name: summary.get(name) for name in HEADLINES[4:]}


def how_to_browse(uri: str, path: str) -> str:
    """The command to start and the page to open to see a run, for a person at a terminal.

    `path` is that of its page; where it is empty, without MLflow, there is nothing to say.
    """
    if not path:
        return ""
    if not is_local(uri):
        return f"{uri.rstrip('/')}{path}"
    address = shlex.quote(f"uri={SQLITE}{database_path(uri)}")
    return f"hlp ui {address}\nthen http://{_HOST}:{PORT}{path}"


def newest_page(uri: str, experiment: str | None = None) -> str:
    """Path of the page of the experiment with the newest run, or of the one of that name.

    Raises MissingFileError without a database or any run, InputError for an unknown experiment.
    """
    if is_local(uri):
        if not database_path(uri).is_file():
            raise MissingFileError(f"no runs in {database_path(uri)} yet: `hlp run` makes one")
        prepare_database(database_path(uri))
    client = import_client()(uri)
    experiments = {found.name: found.experiment_id for found in client.search_experiments()}
    if experiment is not None:
        if experiment not in experiments:
            known = ", ".join(sorted(experiments))
            raise InputError(f"no experiment '{experiment}' in {uri}: there are {known}")
        return experiment_path(experiments[experiment])
    order = ["attributes.start_time DESC"]
    newest = client.search_runs(list(experiments.values()), order_by=order, max_results=1)
    if not newest:
        raise MissingFileError(f"no runs in {uri} yet: `hlp run` makes one")
    return experiment_path(newest[0].info.experiment_id)


@contextmanager
def server(uri: str, port: int = PORT) -> Iterator[str]:
    """MLflow's server of a local database while the block runs; its address.

    One worker, no jobs: two processes instead of ten. It serves no other machine. Raises
    InputError for a port that is taken, NetworkError if the server does not start.
    """
    with socket.socket() as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind((_HOST, port))
        except OSError as error:
            raise InputError(f"port {port} is taken: choose another with port=N") from error
    light = {"MLFLOW_SERVER_ENABLE_JOB_EXECUTION": "false", "MLFLOW_DISABLE_TELEMETRY": "true"}
    command = [sys.executable, "-m", "mlflow", "server", "--workers", "1", "--host", _HOST]
    database = database_path(uri)
    command += ["--port", str(port), "--backend-store-uri", f"{SQLITE}{database}"]
    command += ["--artifacts-destination", artifacts_uri(database)]
    process = subprocess.Popen(  # noqa: S603 - all words stand above or are checked
        command, env={**os.environ, **light}, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
    )
    try:
        address = f"http://{_HOST}:{port}"
        _wait(process, address)
        yield address
    finally:
        process.terminate()
        with suppress(subprocess.TimeoutExpired):
            process.wait(_SHUTDOWN)
        process.kill()


def _wait(process: "subprocess.Popen[bytes]", address: str) -> None:
    """Until the server answers."""
    end = time.monotonic() + _LONGEST_START
    while time.monotonic() < end:
        if process.poll() is not None:
            raise NetworkError(f"MLflow's server ended with {process.returncode}")
        with suppress(OSError), urlopen(f"{address}/health", timeout=5):  # noqa: S310 - ours
            return
        time.sleep(0.2)
    raise NetworkError(f"MLflow's server did not answer within {_LONGEST_START} s")
