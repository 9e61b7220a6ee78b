"""`hlp runs`: what lies in the folder of outputs, with the main figures."""

from collections.abc import Sequence
from pathlib import Path

from hlp.commands import composing
from hlp.errors import HlpError


def command(arguments: Sequence[str]) -> None:
    """Print the list; exits with 2 if the arguments are wrong."""
    given = composing.key_values(arguments, ("output", "format"), RUNS_HELP)
    if given is None:
        return
    from hlp.reporting.run_list import describe_outputs

    try:
        print(describe_outputs(Path(given.get("output", "outputs")), given.get("format", "text")))
    except HlpError as error:
        composing.fail(error)


RUNS_HELP = """\
usage: hlp runs [output=DIR] [format=text|markdown]

Lists the runs and sweeps in or below outputs/ (or DIR), oldest first: whether
they have finished, their targets, the ADD(-S) recall with its 95 % interval,
the 5cm5deg recall, and the time of one object in one frame. A sweep has the
number of its finished runs, of all that have begun, and the figures of its best
arm. Nothing is written.

hlp runs                        all of outputs/
hlp runs output=outputs/demo    those of one experiment

`hlp report output=DIR` tells more about each of them."""
