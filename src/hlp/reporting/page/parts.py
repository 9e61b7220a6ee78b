"""What the pages of runs, sweeps and studies have in common."""

import base64
import json
import logging
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import yaml

from hlp.reporting.results import run_command


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
