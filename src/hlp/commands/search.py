"""`hlp search`: the settings with the best recall within a time limit, by Optuna."""

from collections.abc import Sequence

from hlp.commands import composing, run

SPACE = "space="


def command(arguments: Sequence[str]) -> None:
    """Search a named space, or continue its search."""
    if composing.HELP & set(arguments):
        print(SEARCH_HELP)
        return
    overrides = [f"task/{each}" if each.startswith(SPACE) else each for each in arguments]
    run.command(["task=search", *overrides], "search")


SEARCH_HELP = """\
usage: hlp search [space=NAME] [experiment=NAME] [task.trials=N]
                  [task.limit_ms=T] [overrides]

Optuna tries settings on the configured frames. It looks for the best ADD(-S)
recall among settings whose median time per target is within the limit. It needs
the extra `search`: pip install 'hlp[search]'. Spaces are files in
conf/task/space that list settings with ranges or choices. The first trial is
the unchanged configuration. Stages that trials share are computed once. Each
trial measures its own times.

The study is stored in work/search. The same command continues it; raise
task.trials for more trials. In MLflow the search is one run, and each trial is
a child run of it.

Written into the output folder: search.json, search.csv, search.md,
manifest.json, and search.png and search.svg, which show recall against time of
all trials with the Pareto front.

hlp search                                         refinement, within 500 ms
hlp search space=voting task.trials=50 frames=60   voting, on 60 frames
hlp search experiment=linemod_bop data.root=PATH   on real frames
hlp search task.space.parameters.refinement.particles.high=100   a wider range"""
