"""`report.html` of a study (oracle, basin, bench, search): its tables and figures."""

from pathlib import Path
from typing import Any

from markdown_it import MarkdownIt

from hlp.errors import DataError
from hlp.files import MANIFEST, PAGE, SUMMARY, read_json, write_text
from hlp.reporting.page.parts import how_to_repeat, in_base64, render
from hlp.reporting.study_arms import read_study_sweeps
from hlp.reporting.study_sweep import differences_table, note_of, study_table

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
    page = render(
        "study.html",
        title=f"{study} · {folder.absolute().name}",
        verdict=f"{study} study on data={data}",
        texts=[_MARKDOWN.render(path.read_text("utf-8")) for path in sorted(folder.glob("*.md"))],
        figures=_figures(folder),
        **how_to_repeat(folder, manifest),
    )
    write_text(folder / PAGE, page)
    return folder / PAGE


def _figures(folder: Path) -> dict[str, str]:
    """All SVG files in base64 by name, those of single objects after that of all."""
    paths = sorted(folder.rglob("*.svg"), key=lambda path: (path.stem != "all", path))
    return {path.stem.replace("_", " "): in_base64(path) for path in paths}


def write_study_sweep_page(folder: Path) -> Path:
    """Write `report.html` of a sweep of studies from what lies in its folder; the file.

    Raises DataError for broken files, and for a sweep that holds no study.
    """
    sweeps = read_study_sweeps(folder)
    if not sweeps:
        raise DataError(f"{folder} holds no finished study (oracle, basin, bench, search)")
    parts = []
    for sweep in sweeps:
        figure = folder / f"{sweep.study}.svg"
        pages = [arm.folder / PAGE for arm in sweep.arms]
        parts.append(
            {
                "study": sweep.study,
                "table": study_table(sweep),
                "best": next((i for i, arm in enumerate(sweep.arms) if arm is sweep.best), None),
                "differences": differences_table(sweep),
                "links": [f"{page.parent.name}/{PAGE}" if page.is_file() else "" for page in pages],
                "note": note_of(sweep),
                "figure": in_base64(figure) if figure.is_file() else "",
            }
        )
    page = render(
        "study_sweep.html",
        title=f"sweep of {', '.join(sweeps[0].keys) or 'nothing'} · {folder.absolute().name}",
        verdict=" ".join(sweep.verdict for sweep in sweeps),
        parts=parts,
        command=sweeps[0].command,
    )
    write_text(folder / PAGE, page)
    return folder / PAGE
