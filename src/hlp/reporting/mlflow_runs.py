"""Runs read back from MLflow: their settings and results."""

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from statistics import fmean

from hlp.errors import InputError, MissingFileError
from hlp.files import SCORES
from hlp.reporting.comparison import compare_runs, read_targets
from hlp.reporting.mlflow_client import database_path, import_client, is_local
from hlp.reporting.tables.repeats import mean_and_spread
from hlp.reporting.tables.summary_tables import METRIC_LABELS
from hlp.reporting.tables.table import Table, check_layout, format_share, lay_out
from hlp.reporting.tracking import TrackingSettings
from hlp.results.summary_file import average_recalls

_PER_PAGE = 500


@dataclass(frozen=True)
class LoggedRun:
    """One run in MLflow; `params` are its overrides."""

    run_id: str
    name: str
    status: str
    started: datetime
    params: dict[str, str]
    metrics: dict[str, float]


def read_runs(settings: TrackingSettings) -> list[LoggedRun]:
    """Every run of the experiment, newest first: finished, failed or killed.

    Raises MissingFileError where a local database is absent, InputError for an unknown experiment.
    """
    if is_local(settings.uri) and not database_path(settings.uri).is_file():
        raise MissingFileError(
            f"no MLflow database {database_path(settings.uri)}: `hlp run` makes one"
        )
    client = import_client()(settings.uri)
    experiment = client.get_experiment_by_name(settings.experiment)
    if experiment is None:
        raise InputError(f"no experiment '{settings.experiment}' in {settings.uri}")
    runs: list[LoggedRun] = []
    token = None
    while True:
        page = client.search_runs(
            [experiment.experiment_id], max_results=_PER_PAGE, page_token=token
        )
        runs += [
            LoggedRun(
                run.info.run_id,
                run.info.run_name,
                run.info.status,
                datetime.fromtimestamp(run.info.start_time / 1000, UTC),
                dict(run.data.params),
                dict(run.data.metrics),
            )
            for run in page
        ]
        token = page.token
        if not token:
            return runs


def differences_table(runs: Sequence[LoggedRun], metrics: Sequence[str]) -> Table:
    """A row a run: the settings that differ between the runs, and the named metrics."""
    keys = sorted({key for run in runs for key in run.params})
    differing = [key for key in keys if len({run.params.get(key) for run in runs}) > 1]
    rows = [
        [
            run.name,
            run.status,
            *(run.params.get(key, "") for key in differing),
            *(f"{run.metrics[name]:.3f}" if name in run.metrics else "" for name in metrics),
        ]
        for run in runs
    ]
    return Table(["run", "status", *differing, *metrics], rows)


def scores_file(run: str, uri: str) -> Path:
    """`scores.csv` of a run that is named by its output folder, or by its id in MLflow.

    Raises MissingFileError where neither is found, or the run has no scores.
    """
    if Path(run).is_dir():
        path = Path(run) / SCORES
        if not path.is_file():
            raise MissingFileError(f"no {SCORES} in {run}: it holds no finished run")
        return path
    if is_local(uri) and not database_path(uri).is_file():
        raise MissingFileError(f"no folder {run}, and no MLflow database {uri} to look for it in")
    client = import_client()(uri)
    from mlflow.exceptions import MlflowException

    try:
        return Path(client.download_artifacts(run, SCORES))
    except (MlflowException, OSError) as error:
        raise MissingFileError(f"no folder {run}, and no scores of such a run in {uri}") from error


def describe_named(runs: str, uri: str, layout: str) -> str:
    """What `compare_runs` or `describe_repeats` says of `[A,B,…]`.

    Each is an output folder or the id of a run in MLflow at `uri`. Raises InputError for fewer than
    two, otherwise what these two raise.
    """
    names = [each.strip() for each in runs.removeprefix("[").removesuffix("]").split(",")]
    if len(names) < 2 or not all(names):
        raise InputError(f"runs={runs}: name two or more, as runs=[A,B]")
    files = [scores_file(each, uri) for each in names]
    if len(names) == 2:
        return compare_runs(files[0], files[1], (names[0], names[1]), layout)
    return describe_repeats(files, names, layout)


def describe_repeats(files: Sequence[Path], names: Sequence[str], layout: str) -> str:
    """Recalls of repeats, such as one configuration with several seeds: each, mean and spread.

    `files` are their `scores.csv`; AR is BOP's average recall, empty where it was not computed.
    Raises FileNotFoundError without a file, ValueError for a broken one and for a `layout` that is
    not `text` or `markdown`.
    """
    check_layout(layout)
    recalls, targets = [], []
    for path in files:
        scored = read_targets(path)
        targets.append(scored.keys())
        shares = [fmean(each.correct(key) for each in scored.values()) for key in METRIC_LABELS]
        recalls.append([*shares, average_recalls([each.score for each in scored.values()])["ar"]])
    rows = [
        [name, str(len(asked)), *map(format_share, found)]
        for name, asked, found in zip(names, targets, recalls, strict=True)
    ]
    means, deviations = mean_and_spread(recalls)
    rows += [["mean", "", *means], ["standard deviation", "", *deviations]]
    whole = Table(["run", "targets", *METRIC_LABELS.values(), "AR"], rows)
    table = lay_out(whole.fitted(0, ends=True) if layout == "text" else whole, layout)
    same = all(each == targets[0] for each in targets)
    return table if same else f"{table}\n\nThe runs were not asked for the same targets."
