"""A run's summary as the flat metrics that are logged to MLflow."""

from collections.abc import Mapping
from typing import Any

MLFLOW_METRICS = {"add": "add", "5cm5deg": "pose_5cm5deg", "iou50": "box_iou50"}
"""Name in MLflow of each metric in `summary.json`."""


def summary_metrics(summary: Mapping[str, Any]) -> dict[str, float | None]:
    """Numbers of `summary.json` by name, e.g. `add/recall`, `add/recall_cat`, `time_ms/total`.

    None where nothing was measured.
    """
    flat: dict[str, float | None] = {"targets": summary["targets"]}
    for key, shown in MLFLOW_METRICS.items():
        metric = summary["metrics"][key]
        low, high = metric["ci95"]
        flat |= {f"{shown}/recall": metric["recall"], f"{shown}/mean_object": metric["mean_object"]}
        flat |= {f"{shown}/recall_ci95_low": low, f"{shown}/recall_ci95_high": high}
        for name, scores in summary["per_object"].items():
            flat[f"{shown}/recall_{name}"] = scores[key]["recall"]
    for stage, times in summary["timing_ms"].items():
        flat |= {f"time_ms/{stage}": times["median"], f"time_ms/{stage}_p95": times["p95"]}
    votes, lost = summary["votes"], summary["waterfall"]["total"]
    flat |= {f"votes/{name}": value for name, value in votes["total"].items()}
    for name, each in votes["per_object"].items():
        flat[f"votes/good_{name}"] = each["good"]
        flat[f"votes/good_by_object_{name}"] = each["good_by_object"]
    flat |= {f"waterfall/{name}": count for name, count in lost.items()}
    calibration = summary.get("calibration", {})  # an earlier run has none
    flat |= {f"calibration/{name}": calibration.get(name) for name in ("ece", "aurc")}
    for group in ("median_errors", "bop"):
        flat |= {f"{group}/{name}": value for name, value in summary[group].items()}
    return flat
