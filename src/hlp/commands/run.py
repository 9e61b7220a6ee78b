"""`hlp run`: runs the task of a configuration once, as a sweep, or again from a manifest."""

from __future__ import annotations

import tempfile
import textwrap
from collections.abc import Sequence
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING

from hlp.commands import composing
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
    from hlp.studies import repeat, sweep

    if HydraConfig.get().mode == RunMode.MULTIRUN:
        sweep.run_one(config)
    elif manifest is not None:
        run = build.build_run(config, chosen.chosen_by_hydra())
        repeat.run_again(run, manifest, Path(config.output))
    else:
        run = build.build_run(config, chosen.chosen_by_hydra())
        run.settings.task.run(run, Path(config.output))


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


_WIDTH = 80
_FOLDERS = ("-cd", "--config-dir")


def run_help(arguments: Sequence[str], folder: Path) -> str:
    """The help of `hlp run`, with the alternatives in a folder and in those of the arguments."""
    from hydra import initialize_config_dir
    from hydra.core.global_hydra import GlobalHydra

    from hlp.config.typed_defaults import provide_defaults

    provide_defaults()
    with initialize_config_dir(str(folder.absolute()), version_base="1.3"):
        loader = GlobalHydra.instance().config_loader()
        searched, lines, groups = _searched(arguments), [], loader.list_groups("")
        while groups:
            group = groups.pop(0)
            groups[:0] = [f"{group}/{each}" for each in loader.list_groups(group)]
            if group.partition("/")[0] != "hydra":
                options = loader.get_group_options(group, overrides=searched)
                lines += _folded(group, options) if options else []
    return RUN_HELP.replace("GROUPS\n", "\n".join(lines) + "\n")


def _searched(arguments: Sequence[str]) -> list[str]:
    """`--config-dir` as an override, as Hydra itself takes it."""
    words = [word for each in arguments for word in each.split("=", 1)]
    named = [after for word, after in pairwise(words) if word in _FOLDERS]
    folders = ",".join(f"'file://{Path(each).expanduser().absolute()}'" for each in named)
    given = [each for each in arguments if each.startswith("hydra.searchpath=")]
    return [f"hydra.searchpath=[{folders}]"] if folders else given


def _folded(group: str, options: Sequence[str]) -> list[str]:
    return textwrap.wrap(
        f"{group}: {', '.join(options)}", _WIDTH, subsequent_indent="    ", break_on_hyphens=False
    )


RUN_HELP = """\
usage: hlp run [GROUP=ALTERNATIVE …] [KEY=VALUE …]
       hlp -m [GROUP=A,B …] [KEY=V,W …]   (a sweep)

The whole method, from CAD models to scored poses. Stages already on disk are
reused.

Groups and their alternatives (choose with GROUP=ALTERNATIVE):

GROUPS

Change a value with KEY=VALUE, e.g. seed=1. Keys outside the groups (with their
defaults):

  output=DIR   this run's folder (outputs/EXPERIMENT/TIME)
  work=DIR     folder of finished stages and MLflow's database (work)
  seed=N       seed of all random numbers (0)
  frames=N     use only N frames, spread evenly (all)
  on_bad_frame=fail  end at a frame whose files are broken (report: its targets
               count as wrong)

hlp run                                    the built-in demo
hlp run data=bop data.root=PATH            any data set in BOP's layout
hlp run method=paper                       the paper's method (paper_literal: to
                                           the letter)
hlp run refinement=icp output=outputs/icp  another refiner
hlp run experiment=oracle                  how much recall each stage loses
hlp run experiment=basin                   from which errors a refiner recovers
hlp run -m refinement=pso,icp seed=0,1     a sweep: a run for each combination;
                                           the same command continues it
hlp run executor=loky executor.workers=4   frames in several processes; the same
                                           poses
hlp run -m hydra/launcher=cores seed=0,1   runs of a sweep in parallel (or as
                                           jobs: slurm)
hlp run manifest=FILE                      repeat a run from its manifest.json
hlp run warm_start.manifest=FILE           add objects to those of another run

hlp run --cfg job        print the whole configuration
hlp run --hydra-help     Hydra's own options"""
