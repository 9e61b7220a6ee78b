"""A run's pictures as MLflow's images, which can be compared across runs."""

from collections.abc import Mapping
from pathlib import Path

from hlp.files import SCORES
from hlp.reporting.comparison import read_targets
from hlp.reporting.page.material import FOLDER, read_material
from hlp.reporting.stage_captions import drawn_stages
from hlp.reporting.tracker import Tracker
from hlp.runs.stage_panels import PANELS

MOST_MISSES = 12
"""Missed targets that are logged; the report shows more."""
_GROUP = "1. Pictures"  # MLflow sorts the groups on a run's page by name


def log_pictures(output: Path, tracker: Tracker) -> None:
    """Log poses and panels, a step for each frame; missed targets by cause; those of stages.

    The frame's number is the step, so equal steps of two runs show the same frame.
    """
    for path in sorted((output / PANELS).glob("*.jpg")):
        scene, frame, drawn = path.stem.split("_", 2)
        what = "poses" if drawn == "poses" else "panels"
        tracker.log_image(path, f"{_GROUP}/{what} in scene {int(scene)}", int(frame))
    for path in drawn_stages(output).values():
        tracker.log_image(path, f"{_GROUP}/stages - {path.stem.replace('_', ' ')}", 0)
    scores = read_targets(output / SCORES)
    shown = read_material(output).targets
    missed = [key for key in sorted(shown) if key in scores and not scores[key].correct("add")]
    counted: dict[str, int] = {}
    for key in missed[:: max(1, -(-len(missed) // MOST_MISSES))]:
        cause = (scores[key].score.cause or "unknown").replace("_", " ")
        counted[cause] = step = counted.get(cause, -1) + 1
        tracker.log_image(_picture(output, shown[key]), f"{_GROUP}/missed - {cause}", step)


def _picture(output: Path, target: Mapping[str, str]) -> Path:
    return output / FOLDER / target["picture"]
