"""`manifest.json`: versions, seed, configuration, code, data and stages behind a result.

A run writes its manifest last: a folder with a manifest holds a complete result. From its manifest
a run is repeated: the same configuration and seed, so the same poses.
"""

import dataclasses
import hashlib
import json
import logging
import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import yaml

from hlp.config.build import Run
from hlp.data.dataset import frames_identity
from hlp.errors import ConfigError, DataError
from hlp.files import MANIFEST, POSES, config_folder, read_csv
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


def make_manifest(run: Run, store: StageStore) -> dict[str, Any]:
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


def made_from(run: Run) -> dict[str, Any]:
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


def is_finished(run: Run, output: Path) -> bool:
    """Whether a folder holds the complete result of this run, made by this code from this data.

    The name of the folder does not matter. Raises DataError for a broken manifest.
    """
    if not (output / MANIFEST).is_file():
        return False
    recorded, found = read_manifest(output / MANIFEST), json.loads(json.dumps(made_from(run)))
    recorded["config"]["output"] = found["config"]["output"] = None
    return bool({key: recorded.get(key) for key in found} == found)


def poses_digest(path: Path) -> str:
    """Digest (16 hex digits) of everything in `poses.csv` except the times."""
    digest = hashlib.blake2b(digest_size=8)
    for row in read_csv(path, POSE_COLUMNS):
        digest.update(json.dumps({**row, "time": ""}, sort_keys=True).encode() + b"\n")
    return digest.hexdigest()


_NAME = re.compile(r"[\w][\w .+-]*")


def config_of(manifest: Path, overrides: Sequence[str]) -> str:
    """A `config.yaml` for Hydra with all of a manifest's values.

    Hydra's part and the places where a run is stored (work, output, reporting but for what it is
    about) come from HLP's own. Raises what `read_manifest` and `check_harmless` raise, and
    ConfigError for an override that chooses another file of a group: the manifest's is fixed.
    """
    config = read_manifest(manifest)["config"]
    check_harmless(config, manifest, overrides)
    for override in overrides:
        key = override.partition("=")[0]
        if isinstance(config.get(key), dict):
            raise ConfigError(
                f"{override}: {manifest} fixes {key}; only keys in it can be set ({key}.KEY=VALUE)"
            )
    own = yaml.safe_load((config_folder() / "config.yaml").read_text())
    reporting = yaml.safe_load((config_folder() / "reporting" / "mlflow.yaml").read_text())
    given = config.get("reporting")
    if isinstance(given, dict) and isinstance(given.get("about"), str):
        reporting["about"] = given["about"]
    where = {"work": own["work"], "output": own["output"], "reporting": reporting}
    return json.dumps({"defaults": ["_self_"], **config, **where, "hydra": own["hydra"]})


def run_again(run: Run, manifest: Path, output: Path) -> None:
    """Run the task again, and say whether the poses are the same as those of the manifest's run.

    Raises DataError if the data are not those of the manifest.
    """
    check_manifest(run, manifest)
    run.settings.task.run(run, output)
    digest = read_manifest(manifest).get("poses")
    if digest is None:  # a study's, which has no poses
        return
    if digest == poses_digest(output / POSES):
        logging.getLogger(__name__).info("Repeated  the same poses as in %s", manifest)
    else:
        logging.getLogger(__name__).warning("Repeated  NOT the same poses as in %s", manifest)


def check_manifest(run: Run, manifest: Path) -> None:
    """Raise DataError if the data are not those of the manifest; warn of what else differs.

    The message names the data that differ: models, frames, photographs, … Other code, versions,
    builds of libraries and processors are warned of: with them, poses may differ.
    """
    recorded, found = read_manifest(manifest), made_from(run)  # there and here
    data = recorded.get("data", {})
    changed = [name for name, value in found["data"].items() if data.get(name) != value]
    if changed:
        raise DataError(f"not the data of {manifest}: {', '.join(changed)} differ")
    warn = logging.getLogger(__name__).warning
    if recorded.get("code") != found["code"]:
        warn("HLP's code is not that of %s (%s)", manifest, recorded.get("revision") or "no git")
    for name, version in found["versions"].items():
        if (before := recorded.get("versions", {}).get(name)) != version:
            warn("%s is %s here, and %s in %s", name, version, before, manifest)
    for part, here in (("processor", processor()), ("builds", library_builds())):
        there = recorded.get(part)
        if isinstance(there, dict) and (other := [n for n in here if there.get(n) != here[n]]):
            text = "%s: %s differ from %s; the last bits of results may differ too"
            warn(text, part, ", ".join(other), manifest)


def check_harmless(config: Mapping[str, Any], manifest: Path, overrides: Sequence[str]) -> None:
    """Raise DataError, naming file and key, for a configuration that could do more than it should.

    The address of a cluster is accepted if it is among the overrides too, with any value.
    """
    own_cluster = any(given.startswith("executor.address=") for given in overrides)
    for key, value in entries(config):
        last, text = key.rpartition(".")[2], value if isinstance(value, str) else "name"
        refused = {
            "a manifest holds no configuration of Hydra": key in ("hydra", "defaults"),
            "a manifest names nothing that is to be called": last.startswith("_"),
            "no key is a path": "/" in last or "\\" in last,
            "a manifest holds plain values, which refer to nothing": "${" in text,
            "a name is not a path": last == "name" and not _NAME.fullmatch(text),
            "work would be sent there; give executor.address=… yourself if it is your cluster": (
                key == "executor.address" and value is not None and not own_cluster
            ),
        }
        for why, wrong in refused.items():
            if wrong:
                raise DataError(f"{manifest}: config.{key} is {str(value)[:100]!r}: {why}")


def entries(value: Any, key: str = "") -> Iterator[tuple[str, Any]]:
    """All keys, joined by dots, and their values, those of lists too."""
    if key:
        yield key, value
    items: dict[str, Any] = {}
    if isinstance(value, Mapping):
        items = {f"{key}.{name}" if key else str(name): item for name, item in value.items()}
    elif isinstance(value, list):
        items = {f"{key}[{place}]": item for place, item in enumerate(value)}
    for name, item in items.items():
        yield from entries(item, name)
