"""`report.html` of a study (oracle, basin, bench, search), and of a sweep of runs or studies."""

from pathlib import Path
from typing import Any

from markdown_it import MarkdownIt

from hlp.errors import DataError
from hlp.files import MANIFEST, PAGE, SUMMARY, read_json, write_text
from hlp.reporting.page import how_to_repeat, in_base64, render
from hlp.reporting.summary_tables import METRIC_LABELS
from hlp.reporting.sweep_report import differences_table, note_of, sweep_table
from hlp.reporting.sweeps import Sweep, read_sweeps
from hlp.reporting.table import Table, format_share

# Without HTML: what stands in a text, as an object's name, is shown and not run.
_MARKDOWN = MarkdownIt("commonmark", {"html": False}).enable("table")


def study_folders(root: Path) -> list[Path]:
    """Folders of finished studies in or below `root`.

    They have a manifest that names their task, and tables in Markdown; runs of the whole method
    have a summary instead. Raises DataError for a manifest beside tables that is no JSON.
    """
    found = {path.parent for path in root.rglob(MANIFEST) if not (path.parent / SUMMARY).exists()}
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
    page = render(
        "study.html",
        title=f"{study} · {folder.absolute().name}",
        verdict=f"{study} study on data={data}",
        texts=[_MARKDOWN.render(path.read_text("utf-8")) for path in sorted(folder.glob("*.md"))],
        figures={path.stem.replace("_", " "): in_base64(path) for path in drawn},
        **how_to_repeat(folder, manifest),
    )
    write_text(folder / PAGE, page)
    return folder / PAGE


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
            "differences": differences_table(sweep),
            "links": [
                f"{run.folder.name}/{PAGE}" if (run.folder / PAGE).is_file() else ""
                for run in sweep.runs
            ],
            "note": note_of(sweep),
            "figures": _figures(folder, sweep),
            "objects": objects_by_run(sweep),
        }
        for sweep in sweeps
    ]
    page = render(
        "sweep.html",
        title=f"sweep of {', '.join(sweeps[0].keys) or 'nothing'} · {folder.absolute().name}",
        verdict=" ".join(sweep.verdict for sweep in sweeps),
        parts=parts,
        command=sweeps[0].command,
    )
    write_text(folder / PAGE, page)
    return folder / PAGE


def _figures(folder: Path, sweep: Sweep) -> dict[str, str]:
    """The SVG files of a sweep and of its experiment's report: base64 by caption."""
    captions = {sweep.name: "Runs by what differs"}
    if sweep.results:
        captions["recall_by_time"] = "Recall against time, with the Pareto front"
    captions |= {result.experiment: result.experiment for _, result in sweep.results}
    found = {words: folder / f"{name}.svg" for name, words in captions.items()}
    return {words: in_base64(path) for words, path in found.items() if path.is_file()}


def objects_by_run(sweep: Sweep) -> Table | None:
    """ADD(-S) recall of each object (rows) in each finished run (columns); None for studies."""
    if not sweep.results:
        return None
    found = [(run.short_label, result.summary["per_object"]) for run, result in sweep.results]
    rows = []
    for name in dict.fromkeys(name for _, objects in found for name in objects):
        scores = [objects.get(name) for _, objects in found]
        rows.append([name, *(format_share(score and score["add"]["recall"]) for score in scores)])
    return Table([f"{METRIC_LABELS['add']} of", *(label for label, _ in found)], rows)
