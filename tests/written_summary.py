"""A `summary.json` written by hand."""

from typing import Any


def recall(value: float) -> dict[str, Any]:
    return {"recall": value, "ci95": [value - 0.1, value + 0.1], "mean_object": value / 2}


def quality(good: float | None, votes: float) -> dict[str, Any]:
    shares = ("good", "good_weight", "by_object", "good_by_object")
    values = [None if good is None else good + 0.1 * i for i in range(4)]
    return {**dict(zip(shares, values, strict=True)), "votes": votes}


def summary(names: tuple[str, ...] = ("cat", "ape")) -> dict[str, Any]:
    metrics = {"add": 0.5, "5cm5deg": 0.25, "iou50": 0.75}
    each = {key: {"recall": value} for key, value in metrics.items()}
    return {
        "targets": 8,
        "metrics": {key: recall(value) for key, value in metrics.items()},
        "per_object": {name: {"targets": 4, **each} for name in names},
        "median_errors": {"found": 7, "add_mm": 3.5},
        "bop": {"ar": None, "vsd": None, "mssd": 0.6, "mspd": None},
        "calibration": {"answers": 0, "ece": None, "aurc": None, "reliability": []},
        "false_alarms": {"searched": 0, "alarms": 0, "scores": []},
        "timing_ms": {
            "total": {"median": 480.0, "p95": 700.0},
            "voting": {"median": 2.34, "p95": None},
            "refinement": {"median": None, "p95": None},
        },
        "timing": {
            "frames": 20,
            "objects": 31,
            "reused_stages": [],
            "first_use_seconds": None,
            "cpu_ms": None,
            "wall_ms": 131.0,
            "load": 1.25,
            "cores": 2,
        },
        "waterfall": {
            "total": {"correct": 5, "no_window": 0, "few_votes": 1, "ranking": 2},
            "per_object": {
                "cat": {"correct": 3, "no_window": 0, "few_votes": 1, "ranking": 0},
                "ape": {"correct": 2, "no_window": 0, "few_votes": 0, "ranking": 2},
            },
            "per_visibility": {
                "0.6-1": {"correct": 5, "no_window": 0, "few_votes": 1, "ranking": 2}
            },
        },
        "votes": {
            "total": quality(0.25, 1200.0),
            "per_object": {"cat": quality(0.125, 1000.4), "ape": quality(None, 0.0)},
        },
    }
