"""`report.html` of a study (oracle, basin, bench, search): its tables and figures."""

import base64
import json
import logging
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import yaml
from markdown_it import MarkdownIt

from hlp.errors import DataError
from hlp.files import MANIFEST, PAGE, SUMMARY, read_json, write_text
from hlp.reporting.page.layout import render
from hlp.reporting.results import run_command

# Without HTML: what stands in a text, as an object's name, is shown and not run.
_MARKDOWN = MarkdownIt("commonmark", {"html": False}).enable("table")


def study_folders(root: Path) -> list[Path]:
    """Folders of finished studies in or below `root`.

    They have a manifest that names their task, and tables in Markdown; runs of the whole method
    have a summary instead. Raises DataError for a manifest beside tables that is no JSON.
    """
    found = {path.parent for path in root.rglob(MANIFEST) if not (path.parent / SUMMARY).exists()}
    return sorted(each for each in found if any(each.glob("*.md")) and _task_of(each) is not None)


def _task_of(folder: Path) -> str | None:
    """The name of the task in the manifest; None if it is not one of HLP's."""
    try:
        return str(read_json(folder / MANIFEST)["config"]["task"]["name"])
    except (KeyError, TypeError, IndexError):
        return None


def write_page_or_say(folder: Path) -> None:
    """Write a study's page. An error is only logged: its results do not depend on the page."""
    try:
        write_study_page(folder)
    except Exception:
        logging.getLogger(__name__).exception("the report of %s could not be written", folder)


def write_study_page(folder: Path) -> Path:
    """Write `report.html` of a study from the Markdown and SVG files in its folder; the file.

    Raises MissingFileError and DataError for a manifest that is absent or broken.
    """
    manifest, study = read_json(folder / MANIFEST), _task_of(folder)
    if study is None:
        raise DataError(f"{folder / MANIFEST} is not that of a study: it names no config.task")
    config: Mapping[str, Any] = manifest["config"]
    page = render(
        "study.html",
        title=f"{study} · {folder.absolute().name}",
        verdict=f"{study} study on data={config.get('data', {}).get('name', 'unknown')}",
        texts=[_MARKDOWN.render(path.read_text("utf-8")) for path in sorted(folder.glob("*.md"))],
        figures=_figures(folder),
        command=run_command(folder),
        config=yaml.safe_dump(dict(config), sort_keys=False),
        manifest=json.dumps({k: v for k, v in manifest.items() if k != "config"}, indent=1),
    )
    write_text(folder / PAGE, page)
    return folder / PAGE


def _figures(folder: Path) -> dict[str, str]:
    """All SVG files in base64 by name, those of single objects after that of all."""
    paths = sorted(folder.rglob("*.svg"), key=lambda path: (path.stem != "all", path))
    return {
        path.stem.replace("_", " "): base64.b64encode(path.read_bytes()).decode("ascii")
        for path in paths
    }
