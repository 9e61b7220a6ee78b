"""`report.html` of one run: verdict, charts, targets with their pictures, configuration."""

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from hlp.files import MANIFEST, PAGE, SCORES, SUMMARY, read_json, write_text
from hlp.records import MILLIMETRES_PER_METRE
from hlp.reporting.comparison import ScoredTarget, read_targets
from hlp.reporting.page import charts
from hlp.reporting.page.layout import render
from hlp.reporting.page.material import PageMaterial, picture_path, read_material
from hlp.reporting.page.parts import how_to_repeat, in_base64, run_verdict
from hlp.reporting.sweep_log import drawn_stages
from hlp.reporting.tables.summary_tables import (
    METRIC_LABELS,
    calibration_words,
    false_alarm_words,
    objects_table,
    timing_words,
    waterfall_tables,
)
from hlp.results.summary_file import TargetKey, read_summary

_MOST_BYTES = 10_500_000  # of pictures: in base64 about 14 MB
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
    targets, material = read_targets(folder / SCORES), read_material(folder)
    stages = drawn_stages(folder)
    room = _MOST_BYTES - sum(path.stat().st_size for path in stages.values())
    pictures = _pictures(folder, material, targets, room)
    config: Mapping[str, Any] = manifest.get("config", {})
    page = render(
        "run.html",
        title=f"{config.get('name', 'run')} · {folder.absolute().name}",
        verdict=run_verdict(summary),
        metrics=_metrics(summary),
        objects=objects_table(summary),
        lost=waterfall_tables(summary),
        charts=_charts(summary, list(targets.values()), material),
        times=timing_words(summary),
        scores=" ".join(filter(None, (calibration_words(summary), false_alarm_words(summary)))),
        columns=_COLUMNS,
        digits=_DIGITS,
        rows=_rows(targets, pictures),
        pictures=pictures,
        stages={words: in_base64(path) for words, path in stages.items()},
        scenes=_scenes(material, targets),
        left_out=len(material.targets) - len(pictures),
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
    summary: Mapping[str, Any], targets: Sequence[ScoredTarget], material: PageMaterial
) -> dict[str, str]:
    calibration = summary.get("calibration") or {"answers": 0}
    found = {
        "objects": charts.object_bars(summary),
        "ad_curve": charts.ad_curve(targets, material.diameters_mm),
        "translation": charts.error_histogram(targets, "translation"),
        "rotation": charts.error_histogram(targets, "rotation"),
        "visibility": charts.visibility_bars(targets),
        "waterfall": charts.waterfall_bars(summary),
        "timing": charts.timing_bars(summary),
        "confusion": charts.confusion(summary.get("window_classes", {})),
    }
    if calibration["answers"]:
        found["reliability"] = charts.reliability(calibration)
        found["risk"] = charts.risk_coverage(calibration)
    return found


def _rows(
    targets: Mapping[TargetKey, ScoredTarget], pictures: Mapping[str, str]
) -> list[list[str | float | None]]:
    """A row a target in the order of `_COLUMNS`; the fourth cell is the key of its picture."""
    rows: list[list[str | float | None]] = []
    for key, each in targets.items():
        score, name = each.score, _name(key)
        found = score.found
        rows.append(
            [
                score.scene_id,
                score.frame_id,
                each.name,
                name if name in pictures else None,
                "right" if score.add_correct else "wrong" if found else "not found",
                score.cause.replace("_", " "),
                *_numbers(
                    score.visible_fraction,
                    MILLIMETRES_PER_METRE * score.add_error,
                    math.degrees(score.rotation_error),
                    MILLIMETRES_PER_METRE * score.translation_error,
                    score.score,
                ),
            ]
        )
    return rows


def _numbers(*values: float) -> list[float | None]:
    """Rounded; None for what is no number (nan, inf), which JSON has not."""
    return [round(value, 3) if math.isfinite(value) else None for value in values]


def _pictures(
    folder: Path,
    material: PageMaterial,
    scores: Mapping[TargetKey, ScoredTarget],
    room: int,
) -> dict[str, str]:
    """JPEGs in base64 by the targets' names, as many as there is room (bytes) for, misses first."""

    def right(given: tuple[TargetKey, Mapping[str, Any]]) -> bool:
        return given[0] in scores and scores[given[0]].correct("add")

    pictures = {}
    for key, target in sorted(material.targets.items(), key=right):
        path = picture_path(folder, target)
        room -= 0 if path is None else path.stat().st_size
        if path is not None and room >= 0:
            pictures[_name(key)] = in_base64(path)
    return pictures


def _scenes(
    material: PageMaterial, targets: Mapping[TargetKey, ScoredTarget]
) -> dict[str, dict[str, Any]]:
    """Models by object, and what is around each target that has a picture."""
    return {
        "models": dict(material.objects),
        "targets": {
            _name(key): {**each, "object": targets[key].name}
            for key, each in material.targets.items()
            if key in targets
        },
    }


def _name(key: TargetKey) -> str:
    return "_".join(map(str, key))
