"""What MLflow shows of a sweep on the page of its parent run: table, curves, figures, best arm."""

from collections.abc import Sequence
from pathlib import Path

from hlp.reporting.mlflow_metrics import headline_metrics
from hlp.reporting.results import read_results
from hlp.reporting.sweep_arms import Sweep, sweep_of
from hlp.reporting.sweep_report import describe_sweep
from hlp.reporting.tracker import Tracker

GROUP = "sweep"
_PICTURE = ".png"


def log_sweep(folder: Path, written: Sequence[Path], tracker: Tracker) -> None:
    """Log a sweep's arms and its files, the figures also as images.

    The sweep's own run has the numbers of its best arm.
    """
    sweep = sweep_of(read_results(folder))
    tracker.describe(describe_sweep(folder, "markdown"))
    for step, summary in zip(sweep_steps(sweep), sweep.finished, strict=True):
        metrics = headline_metrics(summary[1].summary)
        tracker.log_metrics({f"{GROUP}/{name}": value for name, value in metrics.items()}, step)
    best = sweep.best
    if best is not None and best.result is not None:
        tracker.set_tags({"best_arm": best.label})
        tracker.log_metrics(headline_metrics(best.result.summary))
    for path in written:
        tracker.log_artifact(path)
    for path in written:
        if path.suffix == _PICTURE:
            tracker.log_image(path, f"figures/{path.stem}", 0)


def sweep_steps(sweep: Sweep) -> list[int]:
    """A step for each finished arm: its value, if one key has whole numbers; else its place.

    So MLflow draws recall over the number of particles by itself.
    """
    values = [arm.values.get(sweep.keys[0], "") for arm, _ in sweep.finished] if sweep.keys else []
    whole = len(sweep.keys) == 1 and all(value.isdecimal() for value in values)
    if whole and len({int(value) for value in values}) == len(values):
        return [int(value) for value in values]
    return list(range(len(sweep.finished)))
