"""`report.html` of a run, of a study (oracle, basin, bench, search), and of a sweep of either."""

import json
import logging
from collections.abc import Callable, Mapping
from datetime import datetime
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import yaml
from markdown_it import MarkdownIt

from hlp.errors import DataError
from hlp.files import MANIFEST, PAGE, SCORES, SUMMARY, SWEEP, read_json, write_text
from hlp.folders import found_below
from hlp.reporting.comparison import ScoredTarget, read_targets
from hlp.reporting.figures import as_svg, charts, in_base64
from hlp.reporting.figures.bars import object_bars
from hlp.reporting.page import report_data
from hlp.reporting.results import run_command
from hlp.reporting.summary_tables import (
    METRIC_LABELS,
    calibration_words,
    false_alarm_words,
    objects_table,
    run_verdict,
    timing_words,
    waterfall_tables,
)
from hlp.reporting.sweep_report import note_of, sweep_table
from hlp.reporting.sweeps import Sweep, read_sweeps
from hlp.results.recalls import TargetKey, read_summary

if TYPE_CHECKING:
    from jinja2 import Environment

_MOST_BYTES = 10_500_000  # of pictures: in base64 about 14 MB
_FRAMES = 24  # in the gallery, at most
_FIGURES = ("waterfall", "calibration")  # that lie as SVG in a run's folder


def write_page(folder: Path, template: str, **values: Any) -> Path:
    """Write `report.html` from a template of the folder `layout`; the file.

    Texts are escaped, JSON is not. The page's date is that of the run's or sweep's last file.
    """
    found = (folder / name for name in (MANIFEST, SWEEP))
    made = max(path.stat().st_mtime for path in found if path.is_file())
    values["date"] = f"{datetime.fromtimestamp(made):%d %B %Y, %H:%M}"
    write_text(folder / PAGE, _templates().get_template(template).render(**values))
    return folder / PAGE


@lru_cache(maxsize=1)
def _templates() -> "Environment":
    from jinja2 import Environment, FileSystemLoader, StrictUndefined

    return Environment(
        loader=FileSystemLoader(Path(__file__).parent / "layout"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )


def page_or_log(write: Callable[[Path], Path], folder: Path) -> Path | None:
    """The page that `write` makes of a folder. An error is only logged, and None returned.

    Results do not depend on their page.
    """
    try:
        return write(folder)
    except Exception:
        logging.getLogger(__name__).exception("the report of %s could not be written", folder)
        return None


def how_to_repeat(folder: Path, manifest: Mapping[str, Any]) -> dict[str, str]:
    """Command, configuration (YAML) and the rest of the manifest (JSON), for the page's end."""
    rest = {key: value for key, value in manifest.items() if key != "config"}
    return {
        "command": run_command(folder),
        "config": yaml.safe_dump(dict(manifest.get("config", {})), sort_keys=False),
        "manifest": json.dumps(rest, indent=1),
    }


def write_run_page(folder: Path) -> Path:
    """Write `report.html` of a finished run from what lies in its folder; the file.

    Runs of older versions have kept neither pictures nor diameters: their page lacks these parts.
    Raises MissingFileError and DataError for files that are absent or broken.
    """
    summary, manifest = read_summary(folder / SUMMARY), read_json(folder / MANIFEST)
    targets, kept = read_targets(folder / SCORES), report_data.ReportData.read(folder)
    stages = report_data.drawn_stages(folder)
    frames = sorted((folder / report_data.PANELS).glob("*_poses.jpg"))[:_FRAMES]
    room = _MOST_BYTES - sum(path.stat().st_size for path in (*stages.values(), *frames))
    pictures = report_data.target_pictures(folder, kept, targets, room)
    config: Mapping[str, Any] = manifest.get("config", {})
    return write_page(
        folder,
        "run.html",
        title=f"{config.get('name', 'run')} · {folder.absolute().name}",
        verdict=run_verdict(summary),
        metrics=_metrics(summary),
        objects=objects_table(summary),
        lost=waterfall_tables(summary),
        charts=_charts(folder, summary, targets, kept),
        frames={path.stem.removesuffix("_poses"): in_base64(path.read_bytes()) for path in frames},
        times=timing_words(summary),
        scores=" ".join(filter(None, (calibration_words(summary), false_alarm_words(summary)))),
        columns=report_data.COLUMNS,
        digits=report_data.DIGITS,
        rows=report_data.target_rows(targets),
        pictures=pictures,
        stages={words: in_base64(path.read_bytes()) for words, path in stages.items()},
        scenes=report_data.target_scenes(kept, targets),
        left_out=len(kept.targets) - len(pictures),
        **how_to_repeat(folder, manifest),
    )


def _metrics(summary: Mapping[str, Any]) -> list[tuple[str, str, str]]:
    """Name, value and interval of the main numbers."""
    shown = []
    for key, label in METRIC_LABELS.items():
        metric = summary["metrics"][key]
        low, high = metric["ci95"]
        shown.append((label, f"{metric['recall']:.3f}", f"{low:.3f} to {high:.3f}"))
    if (average := summary["bop"]["ar"]) is not None:
        shown.append(("BOP's AR", f"{average:.3f}", "mean of VSD, MSSD, MSPD"))
    if (time := summary["timing_ms"]["total"]["median"]) is not None:
        shown.append(("time", f"{time:.0f} ms", "an object in a frame, median"))
    return shown


def _charts(
    folder: Path,
    summary: Mapping[str, Any],
    scores: Mapping[TargetKey, ScoredTarget],
    kept: report_data.ReportData,
) -> dict[str, str]:
    """SVG in base64 by name; empty where there is nothing to draw."""
    targets = list(scores.values())
    diameters = {name: float(wires.diameter_mm) for name, wires in kept.objects.items()}
    figures = {
        "objects": object_bars(summary),
        "ad_curve": charts.ad_curve(targets, diameters),
        "bop": charts.bop_curves(targets),
        "distance": charts.error_by_distance(scores, {s.key: s.truth for s in kept.targets}),
        "translation": charts.error_histogram(targets, "translation"),
        "rotation": charts.error_histogram(targets, "rotation"),
        "visibility": charts.visibility_bars(targets),
        "timing": charts.timing_bars(summary),
    }
    drawn = {name: as_svg(figure) if figure else b"" for name, figure in figures.items()}
    files = {name: folder / f"{name}.svg" for name in _FIGURES}
    drawn |= {name: path.read_bytes() if path.is_file() else b"" for name, path in files.items()}
    return {name: in_base64(svg) for name, svg in drawn.items()}


# Without HTML: what stands in a text, as an object's name, is shown and not run.
_MARKDOWN = MarkdownIt("commonmark", {"html": False}).enable("table")


def study_folders(root: Path) -> list[Path]:
    """Folders of finished studies in or below `root`.

    They have a manifest that names their task, and tables in Markdown; runs of the whole method
    have a summary instead. Raises DataError for a manifest beside tables that is not JSON.
    """
    manifests = found_below(root, MANIFEST)
    found = {path.parent for path in manifests if not (path.parent / SUMMARY).exists()}
    tabled = [folder for folder in sorted(found) if any(folder.glob("*.md"))]
    return [folder for folder in tabled if _task_in(read_json(folder / MANIFEST)) is not None]


def _task_in(manifest: Any) -> str | None:
    """The name of a manifest's task; None if the manifest is not one of HLP's."""
    try:
        return str(manifest["config"]["task"]["name"])
    except (KeyError, TypeError):
        return None


def write_study_page(folder: Path) -> Path:
    """Write `report.html` of a study from the Markdown and SVG files in its folder; the file.

    Raises MissingFileError and DataError for a manifest that is absent or broken.
    """
    manifest = read_json(folder / MANIFEST)
    study = _task_in(manifest)
    if study is None:
        raise DataError(f"{folder / MANIFEST} is not that of a study: it names no config.task")
    data = manifest["config"].get("data", {}).get("name", "unknown")
    drawn = sorted(folder.rglob("*.svg"), key=lambda path: (path.stem != "all", path))
    return write_page(
        folder,
        "study.html",
        title=f"{study} · {folder.absolute().name}",
        verdict=f"{study} study on data={data}",
        texts=[_MARKDOWN.render(path.read_text("utf-8")) for path in sorted(folder.glob("*.md"))],
        figures={path.stem.replace("_", " "): in_base64(path.read_bytes()) for path in drawn},
        **how_to_repeat(folder, manifest),
    )


def write_sweep_page(folder: Path) -> Path:
    """Write `report.html` of a sweep from what lies in its folder; the file.

    Raises DataError for broken files, and for a sweep that holds no finished run.
    """
    sweeps = [sweep for sweep in read_sweeps(folder) if sweep.finished]
    if not sweeps:
        raise DataError(f"{folder} holds no finished run")
    parts = [
        {
            "name": sweep.name,
            "table": sweep_table(sweep),
            "best": next((i for i, run in enumerate(sweep.runs) if run is sweep.best), None),
            "links": [
                f"{run.folder.name}/{PAGE}" if (run.folder / PAGE).is_file() else ""
                for run in sweep.runs
            ],
            "note": note_of(sweep),
            "figures": _figures(folder, sweep),
        }
        for sweep in sweeps
    ]
    return write_page(
        folder,
        "sweep.html",
        title=f"sweep of {', '.join(sweeps[0].keys) or 'nothing'} · {folder.absolute().name}",
        verdict=" ".join(sweep.verdict for sweep in sweeps),
        parts=parts,
        command=sweeps[0].command,
    )


def _figures(folder: Path, sweep: Sweep) -> dict[str, str]:
    """The SVG files of a sweep and of its experiment's report: base64 by caption."""
    captions = {sweep.name: "Runs by what differs"}
    if sweep.results:
        captions["recall_by_time"] = "Recall against time, with the Pareto front"
    captions |= {result.experiment: result.experiment for result in sweep.results}
    found = {words: folder / f"{name}.svg" for name, words in captions.items()}
    return {words: in_base64(path.read_bytes()) for words, path in found.items() if path.is_file()}
