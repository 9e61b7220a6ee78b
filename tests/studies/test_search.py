"""A search over settings, with a stand-in for the runs that it makes."""

import csv
import json
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from hlp.commands.composing import compose_config
from hlp.config.build import Run, build_run
from hlp.errors import DataError
from hlp.records import TargetScore
from hlp.reporting.mlflow.tracking import track_run
from hlp.reporting.study_tables import format_search
from hlp.results.poses_file import write_scores
from hlp.studies import search
from hlp.studies.search import SearchSettings, check_within, nested, read_space

pytestmark = [pytest.mark.slow, pytest.mark.thorough, pytest.mark.usefixtures("threads")]

LIMIT = 200.0
SMALL = ("data.width=320", "data.height=240", "task=search", f"task.limit_ms={LIMIT}")
TARGET = TargetScore(1, 1, 1, True, 1.0, 0.0, 0.0, 0.0, 1.0, True, True, True)
Tried = list[dict[str, Any]]


@pytest.fixture
def start(tmp_path: Path) -> Callable[..., dict[str, Any]]:
    """`hlp search` with some overrides, in this process and in the same `work` every time."""
    pytest.importorskip("optuna", reason="the extra `search` is not installed")

    def call(output: str, *overrides: str) -> dict[str, Any]:
        given = (*SMALL, f"work={tmp_path / 'work'}", f"output={output}", *overrides)
        run = build_run(compose_config(*given))
        assert isinstance(run.settings.task, SearchSettings)
        run.settings.task.run(run, tmp_path / output)
        result: dict[str, Any] = json.loads((tmp_path / output / "search.json").read_text())
        return result

    return call


@pytest.fixture
def tried(monkeypatch: pytest.MonkeyPatch) -> Tried:
    """What trials were begun with. More particles take more time and find more."""
    begun: Tried = []

    def run_method(run: Run, output: Path) -> dict[str, Any]:
        settings: Any = run.settings.refinement
        begun.append({"particles": settings.particles, "theta": settings.theta_deg})
        with track_run(run.settings.reporting, output.name, run.config):
            if len(begun) == begun[0].get("stop_at"):
                raise begun[0]["stop_by"]
        recall, time = settings.particles / 100.0, 10.0 * settings.particles
        output.mkdir(parents=True, exist_ok=True)
        found = [replace(TARGET, frame_id=i, add_correct=i < 100 * recall) for i in range(100)]
        write_scores(output / "scores.csv", found, {1: "cat"})
        return {"metrics": {"add": {"recall": recall}}, "timing_ms": {"total": {"median": time}}}

    monkeypatch.setattr(search.runner, "run_method", run_method)
    return begun


def runs_of(tmp_path: Path) -> tuple[Any, list[Any]]:
    """The search's run in MLflow and those of its trials, oldest first."""
    from mlflow import MlflowClient

    client = MlflowClient(f"sqlite:///{tmp_path / 'work' / 'mlflow.db'}")
    experiment = client.get_experiment_by_name("demo")
    assert experiment is not None
    runs = client.search_runs([experiment.experiment_id], order_by=["start_time ASC"])
    (parent,) = [run for run in runs if "mlflow.parentRunId" not in run.data.tags]
    trials = [run for run in runs if run is not parent]
    assert {run.data.tags["mlflow.parentRunId"] for run in trials} == {parent.info.run_id}
    return parent, trials


def test_the_best_trial_is_the_best_within_the_limit(
    start: Callable[..., dict[str, Any]], tried: Tried, tmp_path: Path
) -> None:
    result = start("out", "task.trials=12")
    assert tried[0] == {"particles": 25, "theta": 10.0}  # the configuration as it stands
    assert len(tried) == 12 and len({trial["particles"] for trial in tried}) > 3
    assert all(5.0 <= trial["theta"] <= 20.0 for trial in tried)
    slow = [trial["particles"] for trial in tried if 10.0 * trial["particles"] > LIMIT]
    fast = [trial["particles"] for trial in tried if 10.0 * trial["particles"] <= LIMIT]
    assert slow and fast
    assert result["best"]["values"]["refinement.particles"] == max(fast)
    with (tmp_path / "out" / "search.csv").open(newline="") as stream:
        rows = list(csv.DictReader(stream))
    assert [int(row["refinement.particles"]) for row in rows] == [t["particles"] for t in tried]
    parent, trials = runs_of(tmp_path)
    assert parent.data.metrics["search/best ADD_-S_"] == max(fast) / 100.0
    logged = [run.data.params["refinement.particles"] for run in trials]
    assert logged == [str(trial["particles"]) for trial in tried]


@pytest.mark.parametrize(("right", "best"), [(53, 0), (90, 1)])
def test_the_unchanged_configuration_wins_a_tie(tmp_path: Path, right: int, best: int) -> None:
    trials = []
    for number, count in enumerate((50, right)):
        folder = tmp_path / str(number)
        folder.mkdir()
        found = [replace(TARGET, frame_id=i, add_correct=i < count) for i in range(100)]
        write_scores(folder / "scores.csv", found, {1: "cat"})
        ended = {"trial": number, "values": {}, "recall": count / 100, "time_ms": 10.0}
        trials.append({**ended, "error": None, "folder": str(folder)})
    task = SearchSettings(space=search.SpaceSettings(name="x", parameters={}))
    result = search._result(task, trials)
    assert result["best"] == trials[best]
    assert ("no other trial is surely better" in format_search(result)) == (best == 0)


@pytest.mark.parametrize("error", [KeyboardInterrupt(), DataError("no such pose")])
def test_a_search_goes_on_where_it_stopped(
    start: Callable[..., dict[str, Any]], tried: Tried, tmp_path: Path, error: BaseException
) -> None:
    """An interrupted trial is begun again; one that failed is not, and the others go on."""
    tried.append({"stop_at": 4, "stop_by": error})  # the third trial
    if isinstance(error, KeyboardInterrupt):
        with pytest.raises(KeyboardInterrupt):
            start("first", "task.trials=4")
        tried[0] = {}
        result = start("second", "task.trials=5")
        assert tried[4] == tried[3]
        assert len(tried) - 1 == 5 + 1
        assert [trial["error"] for trial in result["trials"]] == [None] * 5
        statuses = ["FINISHED", "FINISHED", "KILLED", *["FINISHED"] * 3]
    else:
        result = start("first", "task.trials=4")
        assert [trial["error"] for trial in result["trials"]] == [None, None, "no such pose", None]
        statuses = ["FINISHED", "FINISHED", "FAILED", "FINISHED"]
    parent, trials = runs_of(tmp_path)
    assert parent.info.status == "FINISHED"
    assert [run.info.status for run in trials] == statuses
    count = len(tried)
    for trial in result["trials"]:
        shutil.rmtree(trial["folder"], ignore_errors=True)
    assert start("last", f"task.trials={len(result['trials'])}") == result
    assert len(tried) == count  # nothing is left to try


def test_a_bug_is_raised_and_no_failed_trial(
    start: Callable[..., dict[str, Any]], tried: Tried
) -> None:
    tried.append({"stop_at": 3, "stop_by": ValueError("shapes do not match")})  # second trial
    with pytest.raises(ValueError, match="shapes do not match"):
        start("first", "task.trials=4")
    tried[0] = {}
    result = start("second", "task.trials=2")
    assert tried[3] == tried[2]  # the trial is repeated
    assert [trial["error"] for trial in result["trials"]] == [None, None]


def test_another_configuration_is_another_search(
    start: Callable[..., dict[str, Any]], tried: Tried
) -> None:
    folders = set()
    for overrides in ((), ("seed=1",), ("voting.hypotheses=5",), ("task.limit_ms=100.0",)):
        result = start("out", "task.trials=1", *overrides)
        folders.add(Path(result["trials"][0]["folder"]).parent)
    assert len(folders) == len(tried) == 4


@pytest.mark.parametrize(
    ("override", "words"),
    [
        ("+task.space.parameters.refinement.particels={low:1,high:5}", "has no refinement.part"),
        ("task.space.parameters.refinement.particles.high=20", "leaves out the .* value, 25"),
        ("task.space.parameters.refinement.particles.low=0", "refinement.particles is 0"),
        ("task.space.parameters.refinement.particles=7", "give low and high"),
    ],
)
def test_a_wrong_space_is_named_before_any_trial(
    start: Callable[..., dict[str, Any]], tried: Tried, tmp_path: Path, override: str, words: str
) -> None:
    with pytest.raises(ValueError, match=words):
        start("out", override)
    assert not tried and not (tmp_path / "work").exists()


def test_a_space_is_read_as_ranges_and_choices() -> None:
    given = {"a": {"b": {"low": 1, "high": 5}, "c": {"low": 0.1, "high": 1.0, "log": True}}}
    space = read_space({**given, "d": {"choices": ["x", "y"]}})
    distributions = pytest.importorskip("optuna").distributions
    assert space == {
        "a.b": distributions.IntDistribution(1, 5),
        "a.c": distributions.FloatDistribution(0.1, 1.0, log=True),
        "d": distributions.CategoricalDistribution(("x", "y")),
    }
    config = {"a": {"b": 5, "c": 0.1}, "d": "y"}
    assert nested(check_within(space, config)) == config
    for changed, key in (({"d": "z"}, "d"), ({"a": {"b": 6, "c": 0.1}}, r"a\.b")):
        with pytest.raises(ValueError, match=rf"parameters\.{key} leaves out"):
            check_within(space, {**config, **changed})


@pytest.mark.parametrize(
    "wrong",
    [
        {"low": 5, "high": 5},
        {"low": 1},
        {"choices": [1]},
        {"low": 0, "high": 1, "log": True},
        {"low": 1, "high": 5, "step": 0.5},
    ],
)
def test_a_range_that_holds_nothing_is_named(wrong: dict[str, Any]) -> None:
    with pytest.raises(ValueError, match=r"task\.space\.parameters\.a\.b is"):
        read_space({"a": {"b": wrong}})
