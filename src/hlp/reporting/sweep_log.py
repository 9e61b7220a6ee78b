"""What MLflow shows of a sweep on the page of its parent run: table, curves, figures, best arm."""

from collections.abc import Mapping, Sequence
from pathlib import Path

from hlp.reporting.mlflow_pages import headline_metrics
from hlp.reporting.mlflow_run import MlflowRun
from hlp.reporting.results import read_results
from hlp.reporting.study_arms import StudySweep
from hlp.reporting.study_sweep import describe_study_sweep
from hlp.reporting.sweep_arms import sweep_of
from hlp.reporting.sweep_report import describe_sweep

GROUP = "sweep"
_PICTURE = ".png"


def log_sweep(folder: Path, written: Sequence[Path], tracker: MlflowRun) -> None:
    """Log a sweep's arms and its files, the figures also as images.

    The sweep's own run has the numbers of its best arm.
    """
    sweep = sweep_of(read_results(folder))
    tracker.describe(describe_sweep(folder, "markdown"))
    steps = steps_of(sweep.keys, [arm.values for arm, _ in sweep.finished])
    for step, summary in zip(steps, sweep.finished, strict=True):
        metrics = headline_metrics(summary[1].summary)
        tracker.log_metrics({f"{GROUP}/{name}": value for name, value in metrics.items()}, step)
    best = sweep.best
    if best is not None and best.result is not None:
        tracker.set_tags({"best_arm": best.label})
        tracker.log_metrics(headline_metrics(best.result.summary))
    _log_files(written, tracker)


def log_study_sweeps(
    sweeps: Sequence[StudySweep], written: Sequence[Path], tracker: MlflowRun
) -> None:
    """Log the arms of sweeps of studies, the best one, and their files, figures also as images."""
    tracker.describe("\n\n".join(describe_study_sweep(each, "markdown") for each in sweeps))
    for sweep in sweeps:
        steps = steps_of(sweep.keys, [arm.values for arm, _ in sweep.finished])
        for step, (_, numbers) in zip(steps, sweep.finished, strict=True):
            group = f"{GROUP}/{sweep.study}"
            tracker.log_metrics({f"{group}/{each.name}": each.value for each in numbers}, step)
        if sweep.best is not None:
            tracker.set_tags({"best_arm": sweep.best.label})
    _log_files(written, tracker)


def _log_files(written: Sequence[Path], tracker: MlflowRun) -> None:
    for path in written:
        tracker.log_artifact(path)
    for path in written:
        if path.suffix == _PICTURE:
            tracker.log_image(path, f"figures/{path.stem}", 0)


def steps_of(keys: Sequence[str], arms: Sequence[Mapping[str, str]]) -> list[int]:
    """A step for each arm: its value, if one key has whole numbers; else its place.

    So MLflow draws recall over the number of particles by itself.
    """
    values = [arm.get(keys[0], "") for arm in arms] if keys else []
    whole = len(keys) == 1 and all(value.isdecimal() for value in values)
    if whole and len({int(value) for value in values}) == len(values):
        return [int(value) for value in values]
    return list(range(len(arms)))
