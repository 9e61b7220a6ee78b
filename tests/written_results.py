"""Finished runs and sweeps as `hlp` leaves them, written by hand."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from hlp.records import TargetScore
from hlp.results.poses_file import write_scores

CONFIG: dict[str, Any] = {
    "data": {"name": "bop", "root": "../somewhere/lm"},
    "encoder": {"dimension": 200},
    "machine": {"device": "cpu"},
    "refinement": {"name": "pso", "particles": 25, "theta_deg": 5.0, "tau_mm": 5.0},
}


def recall(value: float) -> dict[str, Any]:
    return {"recall": value, "ci95": [value - 0.1, value + 0.1], "mean_object": value / 2}


def in_vain(searched: int, alarms: int) -> dict[str, Any]:
    rate = alarms / searched if searched else None
    return {"searched": searched, "alarms": alarms, "min_score": 0.5, "rate": rate, "scores": []}


def quality(good: float | None, votes: float) -> dict[str, Any]:
    shares = ("good", "good_weight", "by_object", "good_by_object")
    values = [None if good is None else good + 0.1 * i for i in range(4)]
    return {**dict(zip(shares, values, strict=True)), "votes": votes}


def summary(names: tuple[str, ...] = ("cat", "ape")) -> dict[str, Any]:
    metrics = {"add": 0.5, "5cm5deg": 0.25, "iou50": 0.75}
    each = {key: recall(value) for key, value in metrics.items()}
    return {
        "targets": 8,
        "metrics": {key: recall(value) for key, value in metrics.items()},
        "per_object": {name: {"targets": 4, **each} for name in names},
        "median_errors": {"found": 7, "add_mm": 3.5},
        "bop": {"ar": None, "vsd": None, "mssd": 0.6, "mspd": None},
        "calibration": {"answers": 0, "ece": None, "aurc": None, "reliability": []},
        "false_alarms": in_vain(0, 0),
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


def scored(add: float, ms: float, objects: Mapping[str, float]) -> dict[str, Any]:
    """`summary.json` of twenty targets an object."""
    recalls = {"add": add, "5cm5deg": add - 0.2, "iou50": min(add + 0.05, 1.0)}
    return summary(tuple(objects)) | {
        "targets": 20 * len(objects),
        "metrics": {
            key: {"recall": value, "ci95": [value - 0.1, value + 0.04], "mean_object": value}
            for key, value in recalls.items()
        },
        "per_object": {
            name: {
                "targets": 20,
                **{key: {"recall": value, "ci95": [value - 0.2, value + 0.05]} for key in recalls},
            }
            for name, value in objects.items()
        },
        "timing_ms": {
            "total": {"median": ms, "p95": 2 * ms},
            "refinement": {"median": ms / 4, "p95": ms / 2},
        },
    }


def write_run(
    folder: Path,
    name: str,
    summary: Mapping[str, Any],
    overrides: Sequence[str] = (),
    **groups: Mapping[str, Any],
) -> Path:
    """A finished run of an experiment; `groups` are changes of the configuration's groups."""
    (folder / ".hydra").mkdir(parents=True)
    changed = {key: {**value, **groups.get(key, {})} for key, value in CONFIG.items()}
    manifest = {"config": {"name": name, **changed}, "data": {"keys": ["000001", "000002"]}}
    (folder / "manifest.json").write_text(json.dumps(manifest))
    (folder / "summary.json").write_text(json.dumps(summary))
    (folder / ".hydra" / "overrides.yaml").write_text(json.dumps([*overrides]))
    return folder


def write_sweep(folder: Path, swept: Sequence[str], overrides: Sequence[str]) -> Path:
    """A sweep that is still without runs."""
    folder.mkdir(parents=True)
    record = {"swept": [*swept], "overrides": [*overrides], "status": "FINISHED"}
    (folder / "sweep.json").write_text(json.dumps(record))
    return folder


def write_verdicts(
    run: Path, right: list[int], visible: float = 0.9, scores: Sequence[float] = ()
) -> None:
    """Two targets in each frame; the last one of all is `visible`. Without `scores` all are 0.5."""
    found = []
    for i, (verdict, score) in enumerate(zip(right, scores or [0.5] * len(right), strict=True)):
        seen, verdicts = visible if i == len(right) - 1 else 0.9, [bool(verdict)] * 3
        made = TargetScore(1, i // 2, i % 2, True, seen, 0.001, 0.01, 0.001, 0.9, *verdicts)
        found.append(replace(made, score=score, add_s_correct=bool(verdict)))
    write_scores(run / "scores.csv", found, {0: "ape", 1: "can"})
