"""Pages that stand alone, for a browser; here what those of runs, sweeps and studies share."""

import base64
import json
import logging
from collections.abc import Callable, Mapping
from datetime import datetime
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import yaml

from hlp.files import MANIFEST, PAGE, SWEEP, write_text
from hlp.reporting.results import run_command
from hlp.results.recalls import CORRECT

if TYPE_CHECKING:
    from jinja2 import Environment


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


def in_base64(path: Path) -> str:
    """A picture's file as it stands in a page."""
    return base64.b64encode(path.read_bytes()).decode("ascii")


def run_verdict(summary: Mapping[str, Any]) -> str:
    """How many targets were found, how sure that is, what most misses come from, and the time."""
    add, targets = summary["metrics"]["add"], summary["targets"]
    right = round(add["recall"] * targets)
    low, high = add["ci95"]
    words = f"{right} of {targets} targets have a right pose: ADD(-S) {add['recall']:.3f}"
    words += f" (95 % interval {low:.3f} to {high:.3f})"
    total = summary["waterfall"]["total"].items()
    lost = {name: count for name, count in total if name != CORRECT and count}
    if lost:
        cause = max(lost, key=lambda name: lost[name])
        share = f"{lost[cause]} of {sum(lost.values())}"
        words += f"; most misses come from “{cause.replace('_', ' ')}” ({share})"
    time = summary["timing_ms"]["total"]["median"]
    if time is not None:
        words += f"; an object takes {time:.0f} ms"
    return words + "."
