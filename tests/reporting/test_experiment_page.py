import json

from hlp.reporting.experiment_page import ExperimentPage, experiment_path


def test_a_list_of_runs_shows_their_names_in_full_and_what_one_compares_first() -> None:
    path = experiment_path("7")
    assert path.startswith("/#/experiments/7/runs?")
    view = path.partition("viewStateShareKey=")[2]
    shown = json.loads(ExperimentPage().tags[f"mlflow.sharedViewState.{view}"])
    metrics = ["metrics.`add`", "metrics.`5cm5deg`", "metrics.`iou50`", "metrics.`ms`"]
    assert shown["selectedColumns"] == metrics
    name, *others = shown["columnOrder"]
    assert name == "attributes.`Run Name`" and others[:4] == metrics
    widths = shown["columnWidths"]
    assert max(widths, key=widths.get) == name
    # What is left of 1440 px by MLflow's menu, its assistant, and the boxes before the names.
    in_sight = [name, *metrics, "runDateAndNestInfo"]  # MLflow shows the date beside the name
    assert sum(widths[each] for each in in_sight) <= 820 - 73
