"""`hlp search`: the settings with the best recall within a time limit, by Optuna."""

from collections.abc import Sequence

from hlp.commands import composing, run

SPACE = "space="


def command(arguments: Sequence[str]) -> None:
    """Search a named space, or go on with that search."""
    if composing.HELP & set(arguments):
        print(SEARCH_HELP)
        return
    overrides = [f"task/{each}" if each.startswith(SPACE) else each for each in arguments]
    run.command(["task=search", *overrides], "search")


SEARCH_HELP = """\
usage: hlp search [space=NAME] [experiment=NAME] [task.trials=N] [task.limit_ms=T] [overrides]

Optuna tries settings on the configured frames: the best ADD(-S) recall of those whose median time
of a target is within the limit. Needs the extra `search`: pip install 'hlp[search]'. Spaces are the
files of conf/task/space: settings with ranges or choices. The first trial is the configuration as
it stands. What trials share is computed once.

The study lies in work/search: the same command goes on with it, with more trials if task.trials is
raised. In MLflow it is one run, and each trial a child run of it.

Written into the output folder: search.json, search.csv, search.md and manifest.json.

hlp search                                            what the demo's refinement should do in 500 ms
hlp search space=voting task.trials=50 frames=60      how local patches vote, on 60 frames
hlp search experiment=linemod_bop data.root=PATH         on real frames
hlp search task.space.parameters.refinement.particles.high=100     a wider range"""
