"""`report.html` of one run: verdict, charts, targets with their pictures, configuration."""

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from hlp.files import MANIFEST, PAGE, SCORES, SUMMARY, read_json, write_text
from hlp.records import MILLIMETRES_PER_METRE
from hlp.reporting.comparison import ScoredTarget, read_targets
from hlp.reporting.figures import charts, svg_in_base64
from hlp.reporting.page import how_to_repeat, in_base64, render, run_verdict
from hlp.reporting.page.report_data import ReportData, drawn_stages, picture_path, read_report_data
from hlp.reporting.summary_tables import (
    METRIC_LABELS,
    calibration_words,
    false_alarm_words,
    objects_table,
    timing_words,
    waterfall_tables,
)
from hlp.results.summary_file import TargetKey, read_summary

_MOST_BYTES = 10_500_000  # of pictures: in base64 about 14 MB
_FIGURES = ("waterfall", "calibration")  # that lie as SVG in a run's folder
_COLUMNS = (
    "scene", "image", "object", "", "verdict", "cause", "visible", "ADD(-S) mm", "rotation °",
    "shift mm", "score",
)  # fmt: skip
_DIGITS = (0, 0, 0, 0, 0, 0, 2, 1, 1, 1, 3)


def write_run_page(folder: Path) -> Path:
    """Write `report.html` of a finished run from what lies in its folder; the file.

    Runs of older versions have kept neither pictures nor diameters: their page lacks these parts.
    Raises MissingFileError and DataError for files that are absent or broken.
    """
    summary, manifest = read_summary(folder / SUMMARY), read_json(folder / MANIFEST)
    targets, kept = read_targets(folder / SCORES), read_report_data(folder)
    stages = drawn_stages(folder)
    room = _MOST_BYTES - sum(path.stat().st_size for path in stages.values())
    pictures = _pictures(folder, kept, targets, room)
    config: Mapping[str, Any] = manifest.get("config", {})
    page = render(
        "run.html",
        title=f"{config.get('name', 'run')} · {folder.absolute().name}",
        verdict=run_verdict(summary),
        metrics=_metrics(summary),
        objects=objects_table(summary),
        lost=waterfall_tables(summary),
        charts=_charts(folder, summary, list(targets.values()), kept.diameters_mm),
        times=timing_words(summary),
        scores=" ".join(filter(None, (calibration_words(summary), false_alarm_words(summary)))),
        columns=_COLUMNS,
        digits=_DIGITS,
        rows=_rows(targets, pictures),
        pictures=pictures,
        stages={words: in_base64(path) for words, path in stages.items()},
        scenes=_scenes(kept, targets),
        left_out=len(kept.targets) - len(pictures),
        **how_to_repeat(folder, manifest),
    )
    write_text(folder / PAGE, page)
    return folder / PAGE


def _metrics(summary: Mapping[str, Any]) -> list[tuple[str, str, str]]:
    """Name, value and interval of the main numbers."""
    shown = []
    for key, label in METRIC_LABELS.items():
        metric = summary["metrics"][key]
        low, high = metric["ci95"]
        shown.append((label, f"{metric['recall']:.3f}", f"{low:.3f} to {high:.3f}"))
    average = summary.get("bop", {}).get("ar")
    if average is not None:
        shown.append(("BOP's AR", f"{average:.3f}", "mean of VSD, MSSD, MSPD"))
    time = summary["timing_ms"].get("total", {}).get("median")
    if time is not None:
        shown.append(("time", f"{time:.0f} ms", "an object in a frame, median"))
    return shown


def _charts(
    folder: Path,
    summary: Mapping[str, Any],
    targets: Sequence[ScoredTarget],
    diameters_mm: Mapping[str, float],
) -> dict[str, str]:
    """SVG in base64 by name; empty where there is nothing to draw."""
    figures = {
        "objects": charts.object_bars(summary),
        "ad_curve": charts.ad_curve(targets, diameters_mm),
        "translation": charts.error_histogram(targets, "translation"),
        "rotation": charts.error_histogram(targets, "rotation"),
        "visibility": charts.visibility_bars(targets),
        "timing": charts.timing_bars(summary),
    }
    files = {name: folder / f"{name}.svg" for name in _FIGURES}
    return {
        **{name: svg_in_base64(figure) if figure else "" for name, figure in figures.items()},
        **{name: in_base64(path) if path.is_file() else "" for name, path in files.items()},
    }


def _rows(
    targets: Mapping[TargetKey, ScoredTarget], pictures: Mapping[str, str]
) -> list[list[str | float | None]]:
    """A row a target in the order of `_COLUMNS`; the fourth cell is the key of its picture."""
    rows: list[list[str | float | None]] = []
    for key, target in targets.items():
        score, name = target.score, _name(key)
        numbers = (
            score.visible_fraction,
            MILLIMETRES_PER_METRE * score.add_error,
            math.degrees(score.rotation_error),
            MILLIMETRES_PER_METRE * score.translation_error,
            score.score,
        )
        rows.append(
            [
                score.scene_id,
                score.frame_id,
                target.name,
                name if name in pictures else None,
                "right" if score.add_correct else "wrong" if score.found else "not found",
                score.cause.replace("_", " "),
                # JSON has neither nan nor inf.
                *(round(value, 3) if math.isfinite(value) else None for value in numbers),
            ]
        )
    return rows


def _pictures(
    folder: Path,
    kept: ReportData,
    scores: Mapping[TargetKey, ScoredTarget],
    room: int,
) -> dict[str, str]:
    """JPEGs in base64 by the targets' names, as many as there is room (bytes) for, misses first."""
    right = {key for key, target in scores.items() if target.correct("add")}
    pictures = {}
    for key in sorted(kept.targets, key=lambda key: key in right):
        path = picture_path(folder, kept.targets[key])
        room -= 0 if path is None else path.stat().st_size
        if path is not None and room >= 0:
            pictures[_name(key)] = in_base64(path)
    return pictures


def _scenes(
    kept: ReportData, targets: Mapping[TargetKey, ScoredTarget]
) -> dict[str, dict[str, Any]]:
    """Models by object, and what is around each target that has a picture."""
    return {
        "models": dict(kept.objects),
        "targets": {
            _name(key): {**scene, "object": targets[key].name}
            for key, scene in kept.targets.items()
            if key in targets
        },
    }


def _name(key: TargetKey) -> str:
    return "_".join(map(str, key))
