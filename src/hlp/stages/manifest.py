"""Reads `manifest.json`, which says what a run's result was made from."""

import json
from pathlib import Path
from typing import Any

from hlp.errors import DataError, MissingFileError

FILE = "manifest.json"


def read_manifest(path: Path) -> dict[str, Any]:
    """Read `manifest.json`. Raises MissingFileError, or DataError if it is no manifest."""
    if not path.is_file():
        raise MissingFileError(f"no manifest {path}")
    try:
        manifest = json.loads(path.read_text())
    except ValueError as error:
        raise DataError(f"{path} is no JSON: {error}") from error
    if not isinstance(manifest, dict) or not isinstance(manifest.get("config"), dict):
        raise DataError(f"{path} is no manifest of a run: it has no config")
    return manifest
