"""Reads `manifest.json`, which says what a run's result was made from."""

from pathlib import Path
from typing import Any

from hlp.errors import DataError
from hlp.schemas.reading import read_text_json


def read_manifest(path: Path) -> dict[str, Any]:
    """Read `manifest.json`. Raises MissingFileError, or DataError if it is no manifest."""
    manifest = read_text_json(path)
    if not isinstance(manifest, dict) or not isinstance(manifest.get("config"), dict):
        raise DataError(f"{path} is no manifest of a run: it has no config")
    return manifest
