"""Reads `manifest.json`, which says what made a run's result."""

import json
from pathlib import Path
from typing import Any

FILE = "manifest.json"


def read_manifest(path: Path) -> dict[str, Any]:
    """Read `manifest.json`. Raises FileNotFoundError, and ValueError where it is none."""
    if not path.is_file():
        raise FileNotFoundError(f"no manifest {path}")
    try:
        manifest = json.loads(path.read_text())
    except ValueError as error:
        raise ValueError(f"{path} is no JSON: {error}") from error
    if not isinstance(manifest, dict) or not isinstance(manifest.get("config"), dict):
        raise ValueError(f"{path} is no manifest of a run: it has no config")
    return manifest
