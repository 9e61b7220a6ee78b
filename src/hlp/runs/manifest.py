"""`manifest.json`: the versions, seed, configuration, code, data and stages behind a result.

A run writes its manifest last: a folder with a manifest holds a complete result.
"""

import dataclasses
import hashlib
import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

from hlp.data.dataset import frames_identity
from hlp.files import MANIFEST, read_csv
from hlp.results.poses_file import POSE_COLUMNS
from hlp.stages.manifest import (
    code_digest,
    git_revision,
    library_builds,
    library_versions,
    processor,
    read_manifest,
)
from hlp.stages.store import StageStore

if TYPE_CHECKING:
    from hlp.config.build import Run


def make_manifest(run: "Run", store: StageStore) -> dict[str, Any]:
    """Everything needed to tell whether two results were made in the same way.

    Another processor or another build of a library may change the last bits of a result. They are
    named, but a result that was made with them is finished all the same.
    """
    return {
        **made_from(run),
        "processor": processor(),
        "builds": library_builds(),
        "revision": git_revision(),
        "stages": [dataclasses.asdict(event) for event in store.events],
    }


def made_from(run: "Run") -> dict[str, Any]:
    """Everything that affects a result: versions, code, seed, configuration, data."""
    dataset = run.dataset
    return {
        "versions": library_versions(),
        "code": code_digest(),
        "seed": run.settings.seed,
        "config": run.config,
        "data": {
            "models": {m.name: dataset.model_identities[i] for i, m in dataset.models.items()},
            "frames": dataset.frames_identity,
            "keys": list(run.keys),
            "photographs": dataset.photographs_identity,
            "background_frames": frames_identity(dataset.background_frames),
            "encoder_frames": frames_identity(dataset.encoder_frames),
        },
    }


def is_finished(run: "Run", output: Path) -> bool:
    """Whether a folder holds the complete result of this run, made by this code from this data.

    The name of the folder does not matter. Raises DataError for a broken manifest.
    """
    if not (output / MANIFEST).is_file():
        return False
    manifest = read_manifest(output / MANIFEST)
    return all(
        _without_output(manifest.get(key)) == _without_output(value)
        for key, value in made_from(run).items()
    )


def poses_digest(path: Path) -> str:
    """Digest (16 hex digits) of everything in `poses.csv` except the times."""
    digest = hashlib.blake2b(digest_size=8)
    for row in read_csv(path, POSE_COLUMNS):
        digest.update(json.dumps({**row, "time": ""}, sort_keys=True).encode() + b"\n")
    return digest.hexdigest()


def _without_output(value: Any) -> Any:
    """A part of a manifest as it is in JSON, without the run's own folder."""
    plain = json.loads(json.dumps(value))
    return {**plain, "output": None} if isinstance(plain, dict) else plain
