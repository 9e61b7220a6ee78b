"""`hlp run --help`: the groups of the configuration with their alternatives, and examples."""

import textwrap
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path

_WIDTH = 80
_FOLDERS = ("-cd", "--config-dir")


def run_help(arguments: Sequence[str], folder: Path) -> str:
    """The help of `hlp run`, with the alternatives in a folder and in those of the arguments."""
    from hydra import initialize_config_dir
    from hydra.core.global_hydra import GlobalHydra

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
