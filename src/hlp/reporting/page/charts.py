"""The charts of one run's page, from its summary and its scored targets."""

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from hlp.records import MILLIMETRES_PER_METRE
from hlp.reporting.comparison import ScoredTarget
from hlp.reporting.figures.bench_bars import CAUSE_COLORS, Confusion
from hlp.reporting.page.svg import BLUE, GREY, ORANGE, RED, SKY, Chart, ticks
from hlp.reporting.paper_results import ADD_BY_OBJECT
from hlp.results.intervals import wilson
from hlp.results.summary_file import CORRECT

_WIDTH = 520
_ROW = 22  # px of a horizontal bar
_BINS = 24
_AD_END, _AD_LIMIT = 0.2, 0.1  # of the diameter
_SHARES = [(i / 5, f"{i / 5:.1f}") for i in range(6)]
_LEFT, _CELL, _NAMES = 128, 26, 2.6  # of a matrix: px for names, px of a cell, rows for names
_DARK = 0.55  # share of a row from which numbers are white
_STAGE_CAUSE_COLORS = (SKY, BLUE, ORANGE, RED, GREY)

Targets = Sequence[ScoredTarget]


def object_bars(summary: Mapping[str, Any]) -> str:
    """ADD(-S) recall of each object with its 95 % interval; the paper's as a diamond."""
    scores = summary["per_object"]
    linemod = all(name in ADD_BY_OBJECT for name in scores)
    chart = _rows(list(scores), (0.0, 1.0), 128)
    chart.axes("ADD(-S) recall, 95 % interval", "", _SHARES)
    for row, (name, score) in enumerate(scores.items()):
        recall, count = score["add"]["recall"], score["targets"]
        ends = score["add"].get("ci95")  # older runs have none
        stated = f" ({ends[0]:.3f}-{ends[1]:.3f})" if ends else ""
        title = f"{name}: {recall:.3f}{stated}, {count} targets"
        y = len(scores) - row - 0.5
        chart.bar((0, y - 0.32), (recall, y + 0.32), SKY, title)
        if ends:
            chart.line([(ends[0], y), (ends[1], y)], "#222", 1.5, title=title)
        chart.text((0, y), f"{recall:.3f}", shift=(5, 4))
        if linemod:
            published = ADD_BY_OBJECT[name]
            chart.diamond((published, y), f"paper: {published:.3f}")
    return chart.svg()


def ad_curve(targets: Targets, diameters_mm: Mapping[str, float]) -> str:
    """Share of targets whose ADD(-S) is below a threshold of 0 to 20 % of the diameter.

    The thick line is all targets, the thin ones are objects. Empty without the diameters.
    """
    known = [each for each in targets if each.name in diameters_mm]
    if not known:
        return ""
    groups: dict[str, list[float]] = {}
    for each in known:
        error = each.score.add_error * MILLIMETRES_PER_METRE / diameters_mm[each.name]
        groups.setdefault(each.name, []).append(error)
    chart = Chart(_WIDTH, 300, (0.0, 100 * _AD_END), (0.0, 1.02))
    chart.axes("threshold, % of the diameter", "recall", ticks(0, 100 * _AD_END), _SHARES)
    chart.line([(100 * _AD_LIMIT, 0), (100 * _AD_LIMIT, 1.02)], "#555", 1, "4 3")
    for name, errors in groups.items():
        chart.line(_share_below(errors), "#b9c0ca", 1, title=name)
    everything = [error for errors in groups.values() for error in errors]
    chart.line(_share_below(everything), BLUE, 2.5, title="all targets")
    return chart.svg()


def _share_below(errors: Sequence[float]) -> list[tuple[float, float]]:
    thresholds = np.linspace(0, _AD_END, 81)
    shares = (np.array(errors) < thresholds[:, None]).mean(axis=1)
    return [(100 * float(x), float(y)) for x, y in zip(thresholds, shares, strict=True)]


def error_histogram(targets: Targets, kind: str) -> str:
    """Targets by their error: `translation` (mm) or `rotation` (degrees), right ones and wrong.

    The last bar holds everything beyond the axis. Targets without a pose are left out.
    """
    found = [each for each in targets if each.score.found]
    if kind == "translation":
        errors = [MILLIMETRES_PER_METRE * each.score.translation_error for each in found]
        end, label = 40.0, "translation error, mm"
    else:
        errors = [math.degrees(each.score.rotation_error) for each in found]
        end, label = 30.0, "rotation error, degrees"
    places = np.minimum(np.array(errors) / end * _BINS, _BINS).astype(int)
    right = np.array([each.score.add_correct for each in found], dtype=bool)
    counts = [np.bincount(places[mask], minlength=_BINS + 1) for mask in (right, ~right)]
    step, most = end / _BINS, int((counts[0] + counts[1]).max())
    chart = Chart(_WIDTH, 240, (0.0, end + 2 * step), (0.0, 1.08 * max(most, 1)))
    below = [*ticks(0, end)[:-1], (end + 0.5 * step, "more")]
    chart.axes(label, "targets", below, ticks(0, max(most, 4), 4))
    for i in range(_BINS + 1):
        x = (i + 0.5 * (i == _BINS)) * step
        middle, top = float(counts[0][i]), float(counts[0][i] + counts[1][i])
        title = f"{counts[0][i]} right and {counts[1][i]} wrong by ADD(-S)"
        chart.bar((x, 0), (x + 0.92 * step, middle), BLUE, title)
        chart.bar((x, middle), (x + 0.92 * step, top), ORANGE, title)
    return chart.svg()


def visibility_bars(targets: Targets) -> str:
    """ADD(-S) recall in tenths of the visible fraction with Wilson's 95 % interval.

    Empty if the data set states no visible fraction.
    """
    stated = [each for each in targets if not math.isnan(each.score.visible_fraction)]
    if not stated:
        return ""
    groups: dict[int, list[bool]] = {}
    for each in stated:
        tenth = min(int(10 * each.score.visible_fraction), 9)
        groups.setdefault(tenth, []).append(each.score.add_correct)
    chart = Chart(_WIDTH, 260, (0.0, 10.0), (0.0, 1.08))
    places = [(i, f"{i / 10:.1f}") for i in range(11)]
    chart.axes("visible fraction (numbers: targets)", "ADD(-S) recall", places, _SHARES)
    for tenth, verdicts in sorted(groups.items()):
        recall = float(np.mean(verdicts))
        low, high = wilson(recall, len(verdicts))
        title = f"{recall:.3f} ({low:.3f}-{high:.3f}) of {len(verdicts)} targets"
        chart.bar((tenth + 0.1, 0), (tenth + 0.9, recall), SKY, title)
        chart.line([(tenth + 0.5, low), (tenth + 0.5, high)], "#222", 1.5, title=title)
        chart.text((tenth + 0.5, 0), str(len(verdicts)), "middle", (0, -5))
    return chart.svg()


def waterfall_bars(summary: Mapping[str, Any]) -> str:
    """Missed targets by the cause of the miss; empty if none was missed or no cause is known."""
    total = summary["waterfall"].get("total", summary["waterfall"])
    lost = {name: n for name, n in total.items() if name != CORRECT and n}
    if not lost:
        return ""
    most = max(lost.values())
    chart = _rows([name.replace("_", " ") for name in lost], (0.0, 1.25 * most), 128)
    chart.axes("missed targets", "", ticks(0, 1.25 * max(most, 4)))
    for row, (name, count) in enumerate(lost.items()):
        y, share = len(lost) - row - 0.5, count / max(summary["targets"], 1)
        chart.bar((0, y - 0.32), (count, y + 0.32), CAUSE_COLORS.get(name, GREY))
        chart.text((count, y), f"{count} ({share:.1%})", shift=(5, 4))
    return chart.svg()


def confusion(counts: Mapping[str, Mapping[str, int]]) -> str:
    """Windows at targets by their object (rows) and most likely class; shaded by share of the row.

    `counts` are `window_classes` of `summary.json`; empty without any.
    """
    if not counts:
        return ""
    found = Confusion.of(counts)
    rows, columns = found.counts.shape
    ends = (0.0, float(columns))
    size = (_LEFT + _CELL * columns + 40, round(_ROW * (rows + _NAMES)) + 50)
    chart = Chart(*size, ends, (0.0, rows + _NAMES), _LEFT, 40)
    for column, name in enumerate(found.classes):
        chart.slanted((column + 0.5, rows + 0.15), _short(name, 12))
    for (row, column), count in np.ndenumerate(found.counts):
        share, y = float(found.shares[row, column]), rows - row - 1
        title = f"{found.objects[row]}, taken for {found.classes[column]}: {count} ({share:.1%})"
        chart.bar((column, y), (column + 1, y + 1), _shade(share), title)
        if count:
            chart.text((column + 0.5, y + 0.5), str(count), "middle", light=share > _DARK)
    for row, name in enumerate(found.objects):
        chart.text((0, rows - row - 0.5), _short(name, 20), "end", (-6, 4))
    chart.axes("most likely class of the window at the target", "")
    return chart.svg()


def timing_bars(summary: Mapping[str, Any]) -> str:
    """Median and 95th percentile of each stage's time for one object in one frame (ms)."""
    times = {k: v for k, v in summary["timing_ms"].items() if v.get("median") is not None}
    if not times:
        return ""
    longest = max(each["median"] for each in times.values())
    chart = _rows(list(times), (0.0, 1.45 * longest), 90)
    chart.axes("ms for one object in one frame, median (95th percentile)", "",
               ticks(0, 1.45 * longest))  # fmt: skip
    for row, (name, each) in enumerate(times.items()):
        y = len(times) - row - 0.5
        color = "#444" if name == "total" else _STAGE_CAUSE_COLORS[row % len(_STAGE_CAUSE_COLORS)]
        chart.bar((0, y - 0.32), (each["median"], y + 0.32), color)
        high = "" if each["p95"] is None else f" ({each['p95']:.0f})"
        chart.text((each["median"], y), f"{each['median']:.3g}{high}", shift=(5, 4))
    return chart.svg()


def reliability(calibration: Mapping[str, Any]) -> str:
    """Share of right answers against their mean score: discs grow with the number of answers."""
    chart = Chart(400, 300, (0.0, 1.0), (0.0, 1.02))
    chart.axes("mean score", "share of right answers", _SHARES, _SHARES)
    chart.line([(0, 0), (1, 1)], GREY, 1, "4 3")
    most = max(row[0] for row in calibration["reliability"])
    for count, score, share in calibration["reliability"]:
        title = f"{count:.0f} answers: score {score:.2f}, right {share:.2f}"
        chart.dot((score, share), BLUE, 3 + 8 * (count / most) ** 0.5, title)
    return chart.svg()


def risk_coverage(calibration: Mapping[str, Any]) -> str:
    """Share of wrong answers among the most certain ones, against how many are kept."""
    points = [(float(x), float(y)) for x, y in calibration["risk_coverage"]]
    top = max(0.05, 1.15 * max(y for _, y in points))
    chart = Chart(400, 300, (0.0, 1.0), (0.0, top))
    chart.axes("coverage: share of answers kept", "share of wrong answers", _SHARES, ticks(0, top))
    chart.line(points, RED, 2)
    return chart.svg()


def _rows(names: Sequence[str], ends: tuple[float, float], left: int) -> Chart:
    """An empty chart with a named row for each bar, the first at the top."""
    chart = Chart(_WIDTH, _ROW * len(names) + 52, ends, (0.0, float(len(names))), left, 24)
    for row, name in enumerate(names):
        chart.text((ends[0], len(names) - row - 0.5), _short(name, 20), "end", (-6, 4))
    return chart


def _short(name: str, most: int) -> str:
    return name if len(name) <= most else f"{name[: most - 1]}…"


def _shade(share: float) -> str:
    """From white to blue."""
    return "#" + "".join(f"{round(255 + share * (end - 255)):02x}" for end in (0x00, 0x72, 0xB2))
