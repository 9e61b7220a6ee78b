"""What made a result: versions, seed, configuration, code, data and stages (`manifest.json`)."""

import dataclasses
import json
import os
from pathlib import Path
from typing import Any

from hlp.pipeline.build import Run
from hlp.pipeline.provenance import code_digest, library_versions
from hlp.pipeline.store import StageStore
from hlp.pipeline.world import frames_identity


def make_manifest(planned: Run, store: StageStore) -> dict[str, Any]:
    """Everything needed to tell whether two results were made alike."""
    world = planned.world
    return {
        "versions": library_versions(),
        "code": code_digest(),
        "seed": planned.settings.seed,
        "config": planned.config,
        "data": {
            "models": {m.name: world.model_identities[i] for i, m in world.models.items()},
            "frames": world.frames_identity,
            "keys": list(planned.keys),
            "photographs": world.photographs_identity,
            "background_frames": frames_identity(world.background_frames),
            "encoder_frames": frames_identity(world.encoder_frames),
        },
        "stages": [dataclasses.asdict(event) for event in store.events],
    }


def write_json(path: Path, content: dict[str, Any]) -> None:
    """Write JSON at once or not at all."""
    begun = path.with_name(path.name + ".begun")
    begun.write_text(json.dumps(content, indent=2) + "\n")
    os.replace(begun, path)
