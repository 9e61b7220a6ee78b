"""`summary.json`: recalls, times and causes of misses of one run."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

from hlp.errors import DataError
from hlp.files import read_json
from hlp.records import TargetScore

Summary = dict[str, Any]

CORRECT = "correct"
"""Stands beside the causes of misses in a waterfall."""
METRICS: dict[str, Callable[[TargetScore], bool]] = {
    "add": lambda score: score.add_correct,
    "5cm5deg": lambda score: score.pose_correct,
    "iou50": lambda score: score.box_correct,
}
"""Name of each metric in `summary.json`, and the verdict of a score that it counts."""

_REQUIRED = {"targets", "metrics", "per_object", "timing_ms", "waterfall"}


def read_summary(path: Path) -> Summary:
    """Read `summary.json`. Raises MissingFileError, and DataError if it is not one."""
    summary: Summary = read_json(path)
    if not isinstance(summary, dict) or (missing := _REQUIRED - summary.keys()):
        lacks = f": it lacks {', '.join(sorted(missing))}" if isinstance(summary, dict) else ""
        raise DataError(f"{path} is no summary of a run{lacks}")
    return summary
