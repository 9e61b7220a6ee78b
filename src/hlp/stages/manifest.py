"""Reads `manifest.json`, which says what made a run's result."""

from pathlib import Path
from typing import Any

from hlp.files import read_json


def read_manifest(path: Path) -> dict[str, Any]:
    """Read `manifest.json`. Raises FileNotFoundError, and ValueError where it is none."""
    manifest = read_json(path)
    if not isinstance(manifest, dict) or not isinstance(manifest.get("config"), dict):
        raise ValueError(f"{path} is no manifest of a run: it has no config")
    return manifest
