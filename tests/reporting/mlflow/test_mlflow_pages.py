"""What MLflow's pages show of runs."""

import json
import shlex
from pathlib import Path

import pytest

from hlp.reporting.mlflow.pages import (
    experiment_path,
    experiment_tags,
    how_to_browse,
    run_path,
    short_name,
    summary_metrics,
)
from written_results import summary


@pytest.mark.parametrize(
    ("values", "groups", "name"),
    [
        (
            {"refinement": "icp", "refinement.particles": "25", "seed": "1"},
            {"refinement", "data"},
            "icp, particles 25, seed 1",
        ),
        ({}, (), "demo"),
        # What changes no pose is not named.
        (
            {"data": "bop", "data.root": "/a/b", "panels": "0", "machine.threads": "1"},
            {"data"},
            "bop",
        ),
        (
            {f"a.key{i}": "v" for i in range(20)},
            (),
            "key0 v, key1 v, key2 v, key3 v, key4 v, key5 v,…",
        ),
    ],
)
def test_names_begin_with_what_differs(values: dict[str, str], groups: set[str], name: str) -> None:
    assert short_name(values, groups, "demo") == name


def test_a_list_of_runs_shows_their_names_in_full_and_what_one_compares_first() -> None:
    path = experiment_path("7")
    assert path.startswith("/#/experiments/7/runs?")
    view = path.partition("viewStateShareKey=")[2]
    shown = json.loads(experiment_tags()[f"mlflow.sharedViewState.{view}"])
    names = ("add", "targets", "frames", "ms", "5cm5deg", "iou50")
    metrics = [f"metrics.`{name}`" for name in names]
    assert shown["selectedColumns"] == metrics
    name, *others = shown["columnOrder"]
    assert name == "attributes.`Run Name`" and others[:6] == metrics
    # What is left of 1440 px by MLflow's menu, its assistant, and the boxes before the names.
    in_sight = [name, *metrics[:4], "runDateAndNestInfo"]  # MLflow shows the date beside the name
    assert sum(shown["columnWidths"][column] for column in in_sight) <= 820 - 73


def test_an_experiment_is_described_in_words() -> None:
    note = experiment_tags("A sweep.", "hlp -m seed=0,1", "demo")["mlflow.note.content"]
    assert note == "A sweep.\n\nCommand: `hlp -m seed=0,1`\n\nData of the first run: demo"
    assert "mlflow.note.content" not in experiment_tags()


def test_metrics_bear_the_names_that_mlflow_takes() -> None:
    flat = summary_metrics(summary())
    expected = {
        "add_by_object/cat": 0.5,
        "ci95/5cm5deg_low": 0.15,
        "mean_object/iou50": 0.375,
        "time_ms/total": 480.0,
        "time_ms/voting_p95": None,
        "waterfall/correct": 5,
        "waterfall/few_votes": 1,
        "votes/good": 0.25,
        "votes/good_weight": 0.35,
        "votes_by_object/good_by_object_cat": 0.425,
        "votes_by_object/good_cat": 0.125,
        "votes_by_object/good_ape": None,
        "median_errors/add_mm": 3.5,
        "bop/vsd": None,
        "targets": 8,
    }
    assert {name: flat[name] for name in expected} == pytest.approx(expected)


def test_what_one_compares_first_is_short_and_stands_above_all_groups() -> None:
    long = summary()
    long["metrics"]["add"]["recall"] = 134 / 142
    long["timing_ms"]["total"]["median"] = 912.3456
    flat = summary_metrics({**long, "frames": 4})
    first = {name: value for name, value in flat.items() if "/" not in name}
    recalls = {"add": 0.9437, "5cm5deg": 0.25, "iou50": 0.75}
    assert first == {**recalls, "ms": 912.3, "targets": 8, "frames": 4}
    assert flat["time_ms/total"] == 912.3456


def test_browsing_is_told_as_a_command_that_works_from_anywhere(tmp_path: Path) -> None:
    path = run_path("7", "abc")
    assert path == "/#/experiments/7/runs/abc?workflowType=machine_learning"
    uri = f"sqlite:///{tmp_path / 'my runs'}/mlflow.db"
    command, page = how_to_browse(uri, path).split("\n")
    assert shlex.split(command) == ["hlp", "ui", f"uri={uri}"]
    assert page == f"then http://127.0.0.1:5000{path}"
    assert how_to_browse("http://server:5000/", path) == f"http://server:5000{path}"
    assert how_to_browse("sqlite:///a.db", "") == ""
