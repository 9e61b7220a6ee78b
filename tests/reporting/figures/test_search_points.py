from pathlib import Path
from typing import Any

import cv2

from hlp.reporting.figures.trade_off import FRONT, search_points, write_search_figure


def trial(number: int, recall: float | None, ms: float | None) -> dict[str, Any]:
    error = "no particles" if recall is None else None
    return {
        "trial": number,
        "values": {"n": number},
        "recall": recall,
        "time_ms": ms,
        "error": error,
    }


def result(*trials: dict[str, Any], best: int | None) -> dict[str, Any]:
    chosen = next((each for each in trials if each["trial"] == best), None)
    return {"space": "refinement", "limit_ms": 200.0, "best": chosen, "trials": [*trials]}


TRIALS = (trial(0, 0.8, 150.0), trial(1, None, None), trial(2, 0.9, 190.0), trial(3, 0.95, 260.0))


def test_limit_front_and_best_trial_are_drawn_and_failures_are_not() -> None:
    (ax,) = search_points(result(*TRIALS, best=2)).axes
    lines = {str(line.get_label()): line for line in ax.get_lines()}
    assert list(lines["limit 200 ms"].get_xdata()) == [200.0, 200.0]
    assert list(lines[FRONT].get_ydata()) == [0.8, 0.9, 0.95, 0.95]
    (star,) = [line for words, line in lines.items() if words.endswith("trial 2")]
    assert (*star.get_xdata(), *star.get_ydata()) == (190.0, 0.9)
    (points,) = ax.collections
    assert points.get_offsets().tolist() == [[150.0, 0.8], [190.0, 0.9], [260.0, 0.95]]
    colors = [tuple(each) for each in points.get_facecolors()]
    assert colors[0] == colors[1] != colors[2]  # over the limit
    assert [(text.get_text(), text.xy) for text in ax.texts] == [
        ("unchanged configuration", (150.0, 0.8))
    ]


def test_a_search_without_a_trial_within_the_limit_names_no_best() -> None:
    (ax,) = search_points(result(TRIALS[3], best=None)).axes
    assert not [line for line in ax.get_lines() if "best" in str(line.get_label())]


def test_files_are_written_if_a_trial_succeeded(tmp_path: Path) -> None:
    assert write_search_figure(tmp_path, result(TRIALS[1], best=None)) == []
    written = write_search_figure(tmp_path, result(*TRIALS, best=2))
    assert [path.name for path in written] == ["search.png", "search.svg"]
    assert cv2.imread(str(written[0])).shape[1] > 600
