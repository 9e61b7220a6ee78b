"""A run's summary as the flat metrics that are logged to MLflow."""

from collections.abc import Mapping
from typing import Any

HEADLINES = ("add", "5cm5deg", "iou50", "ms")
"""The numbers that one compares first. All others have names with a group: `time_ms/total`."""
_RECALLS = HEADLINES[:3]


def summary_metrics(summary: Mapping[str, Any]) -> dict[str, float | None]:
    """Numbers of `summary.json` by name, e.g. `add`, `add_by_object/cat`, `time_ms/voting`.

    None where nothing was measured.
    """
    flat = headline_metrics(summary)
    flat["counts/targets"] = summary["targets"]
    for key in _RECALLS:
        metric = summary["metrics"][key]
        low, high = metric["ci95"]
        flat |= {f"ci95/{key}_low": low, f"ci95/{key}_high": high}
        flat[f"mean_object/{key}"] = metric["mean_object"]
        for name, scores in summary["per_object"].items():
            flat[f"{key}_by_object/{name}"] = scores[key]["recall"]
    for stage, times in summary["timing_ms"].items():
        flat |= {f"time_ms/{stage}": times["median"], f"time_ms/{stage}_p95": times["p95"]}
    votes, lost = summary["votes"], summary["waterfall"]["total"]
    flat |= {f"votes/{name}": value for name, value in votes["total"].items()}
    for name, each in votes["per_object"].items():
        flat[f"votes_by_object/good_{name}"] = each["good"]
        flat[f"votes_by_object/good_by_object_{name}"] = each["good_by_object"]
    flat |= {f"waterfall/{name}": count for name, count in lost.items()}
    calibration = summary.get("calibration", {})  # an earlier run has none
    flat |= {f"calibration/{name}": calibration.get(name) for name in ("ece", "aurc")}
    for group in ("median_errors", "bop"):
        flat |= {f"{group}/{name}": value for name, value in summary[group].items()}
    return flat


def headline_metrics(summary: Mapping[str, Any]) -> dict[str, float | None]:
    """Recalls and median time (ms, of one object in one frame) of `summary.json`.

    Rounded, since MLflow's columns would show `0.943661…`.
    """
    values = {key: summary["metrics"][key]["recall"] for key in _RECALLS}
    values[HEADLINES[3]] = summary["timing_ms"]["total"]["median"]
    digits = dict(zip(HEADLINES, (4, 4, 4, 1), strict=True))
    return {k: None if v is None else round(v, digits[k]) for k, v in values.items()}
