"""`hlp upload`: sends the runs that were kept here while MLflow's server was unreachable."""

from collections.abc import Mapping, Sequence
from pathlib import Path

from hlp.commands import composing, own_arguments


def command(arguments: Sequence[str]) -> None:
    """Send them and print their names; exits with 2 if the arguments are wrong."""
    given = composing.key_values(arguments, ("work", "unsent", "uri"), UPLOAD_HELP)
    if given is None:
        return
    own_arguments.call(lambda: _send(given))


def _send(given: Mapping[str, str]) -> None:
    from hlp.reporting.mlflow_upload import send_runs, unsent_database

    unsent = given.get("unsent") or unsent_database(Path(given.get("work", "work")))
    names = send_runs(unsent, given.get("uri"))
    print("\n".join([*names, f"{len(names)} runs sent"]))


UPLOAD_HELP = """\
usage: hlp upload [work=DIR] [unsent=DATABASE] [uri=SERVER]

Sends the runs that `hlp run` has kept in DIR/unsent because MLflow's server was
unreachable, with all their numbers, files and images. What is sent is removed
here.

  work    folder of the runs, as for `hlp run` (work)
  unsent  the database of these runs, if `reporting.unsent` named another
  uri     another server than the one that each run was meant for

hlp upload                                     all that wait in work/
hlp upload uri=http://mlflow.example.org:5000  to a server with a new address"""
