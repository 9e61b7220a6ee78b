"""A run repeated from its `manifest.json`: the same configuration and seed, so the same poses."""

import json
import logging
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import yaml

from hlp.errors import ConfigError, DataError
from hlp.files import POSES
from hlp.runs.manifest import made_from, poses_digest
from hlp.stages.manifest import library_builds, processor, read_manifest
from hlp.studies.search_space import check_harmless

if TYPE_CHECKING:
    from hlp.config.build import Run


def config_of(manifest: Path, overrides: Sequence[str], configuration: Path) -> str:
    """A `config.yaml` for Hydra with all of a manifest's values.

    `configuration` is the folder of HLP's configuration. Hydra's part and the places where a run is
    stored (work, output, reporting but for what it is about) come from there. Raises what
    `read_manifest` and `check_harmless` raise, and ConfigError for an override that chooses another
    file of a group: the manifest's is fixed.
    """
    config = read_manifest(manifest)["config"]
    check_harmless(config, manifest, overrides)
    for override in overrides:
        key = override.partition("=")[0]
        if isinstance(config.get(key), dict):
            raise ConfigError(
                f"{override}: {manifest} fixes {key}; only keys in it can be set ({key}.KEY=VALUE)"
            )
    own = yaml.safe_load((configuration / "config.yaml").read_text())
    reporting = yaml.safe_load((configuration / "reporting" / "mlflow.yaml").read_text())
    told = config.get("reporting")
    if isinstance(told, dict) and isinstance(told.get("about"), str):
        reporting["about"] = told["about"]
    where = {"work": own["work"], "output": own["output"], "reporting": reporting}
    return json.dumps({"defaults": ["_self_"], **config, **where, "hydra": own["hydra"]})


def run_again(run: "Run", manifest: Path, output: Path) -> None:
    """Run the task again, and say whether the poses are the same as those of the manifest's run.

    Raises DataError if the data are not those of the manifest.
    """
    from hlp.studies import tasks

    check_manifest(run, manifest)
    tasks.run_task(run, output)
    digest = read_manifest(manifest).get("poses")
    if digest is None:  # a study's, which has no poses
        return
    if digest == poses_digest(output / POSES):
        logging.getLogger(__name__).info("Repeated  the same poses as in %s", manifest)
    else:
        logging.getLogger(__name__).warning("Repeated  NOT the same poses as in %s", manifest)


def check_manifest(run: "Run", manifest: Path) -> None:
    """Raise DataError if the data are not those of the manifest; warn of what else differs.

    The message names the data that differ: models, frames, photographs, … Other code, versions,
    builds of libraries and processors are warned of: with them, poses may differ.
    """
    wanted, found = read_manifest(manifest), made_from(run)
    data = wanted.get("data", {})
    changed = [name for name, value in found["data"].items() if data.get(name) != value]
    if changed:
        raise DataError(f"not the data of {manifest}: {', '.join(changed)} differ")
    warn = logging.getLogger(__name__).warning
    if wanted.get("code") != found["code"]:
        warn("HLP's code is not that of %s (%s)", manifest, wanted.get("revision") or "no git")
    for name, version in found["versions"].items():
        before = wanted.get("versions", {}).get(name)
        if before != version:
            warn("%s is %s here, and %s in %s", name, version, before, manifest)
    _warn_of_machine(wanted, manifest)


def _warn_of_machine(wanted: Mapping[str, Any], manifest: Path) -> None:
    """Warn of another processor and of other builds of libraries, where the manifest names them."""
    warn = logging.getLogger(__name__).warning
    for part, here in (("processor", processor()), ("builds", library_builds())):
        there = wanted.get(part)
        if not isinstance(there, dict):
            continue
        differing = [name for name in here if there.get(name) != here[name]]
        if differing:
            text = "%s: %s differ from %s; the last bits of results may differ too"
            warn(text, part, ", ".join(differing), manifest)
