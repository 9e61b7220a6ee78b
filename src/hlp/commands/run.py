"""`hlp run`: runs the task of a configuration once, as a sweep, or again from a manifest."""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from hlp.commands import composing
from hlp.commands.run_help import run_help
from hlp.errors import HlpError

if TYPE_CHECKING:
    from omegaconf import DictConfig

MANIFEST = "manifest="


def command(arguments: Sequence[str], name: str = "run") -> None:
    """Compose the configuration, build what it names, and run its task."""
    if composing.HELP & {*arguments}:
        print(run_help(arguments, composing.config_folder()))
        return
    if any(each.startswith(MANIFEST) for each in arguments):
        _repeat(arguments)
        return
    swept = composing.MULTIRUN & {*arguments}
    if swept:
        from hlp.studies.sweep import unfinished_sweep

        folder = unfinished_sweep(arguments, Path("outputs"))
        if folder is not None:
            print(f"continuing the sweep in {folder}")
            arguments = [*arguments, f"output='{folder}'"]
    composing.compose_and_call(name, arguments, _run, composing.config_folder())


def _run(config: DictConfig, manifest: Path | None = None) -> None:
    """Build what the composed configuration names, and run its task.

    With a `manifest`, the configuration comes from it, and data and poses are compared with it.
    """
    from hydra.core.hydra_config import HydraConfig
    from hydra.types import RunMode

    if config.output != "":  # otherwise the settings say that it is empty
        config.output = HydraConfig.get().runtime.output_dir  # each run of a sweep has its own

    from hlp.config import build, chosen
    from hlp.studies import repeat, sweep, tasks

    if HydraConfig.get().mode == RunMode.MULTIRUN:
        sweep.run_one(config)
    elif manifest is not None:
        run = build.build_run(config, chosen.chosen_by_hydra())
        repeat.run_again(run, manifest, Path(config.output))
    else:
        run = build.build_run(config, chosen.chosen_by_hydra())
        tasks.run_task(run, Path(config.output))


def _repeat(arguments: Sequence[str]) -> None:
    from hlp.studies.repeat import config_of

    overrides = [each for each in arguments if not each.startswith(MANIFEST)]
    named = [each.removeprefix(MANIFEST) for each in arguments if each.startswith(MANIFEST)]
    manifest = Path(named[-1]).expanduser()
    try:
        config = config_of(manifest, overrides, composing.config_folder())
    except HlpError as error:
        composing.fail(error)
    with tempfile.TemporaryDirectory() as folder:
        Path(folder, "config.yaml").write_text(config)
        again = partial(_run, manifest=manifest)
        composing.compose_and_call("run", overrides, again, Path(folder))
