"""Reads `manifest.json`, which says what a run's result was made from."""

from pathlib import Path
from typing import Any

from hlp.errors import DataError
from hlp.schemas.reading import read_text_json
from hlp.stages.fingerprint import is_fingerprint


def read_manifest(path: Path) -> dict[str, Any]:
    """Read `manifest.json`. Raises MissingFileError, or DataError if it is no manifest."""
    manifest = read_text_json(path)
    if not isinstance(manifest, dict) or not isinstance(manifest.get("config"), dict):
        raise DataError(f"{path} is no manifest of a run: it has no config")
    return manifest


def made_outputs(path: Path) -> dict[tuple[str, str], str]:
    """Fingerprints of the outputs that a manifest names, by stage and object's name.

    The name is empty for an output of all objects. Raises what `read_manifest` raises.
    """
    stages = read_manifest(path).get("stages")
    try:
        made = {
            (str(each["stage"]), str(each.get("of", ""))): str(each["fingerprint"])
            for each in stages or ()
        }
    except (TypeError, KeyError, AttributeError) as error:
        raise DataError(f"{path} is damaged: stages are {stages!r}") from error
    for (stage, _), name in made.items():
        if not is_fingerprint(name):
            raise DataError(f"{path}: {name!r} is no fingerprint of a stage '{stage}'")
    return made
