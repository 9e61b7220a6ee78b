"""`hlp ui`: the runs in a browser, by MLflow's own server."""

import os
import sys
import time
from collections.abc import Mapping, Sequence

from hlp.commands import composing, own_arguments
from hlp.commands.tracking_uri import tracking_uri
from hlp.errors import InputError


def command(arguments: Sequence[str]) -> None:
    """Start the server and show its address until Ctrl-C; exits with 2 for wrong arguments."""
    keys = ("uri", "work", "experiment", "port", "open")
    given = composing.key_values(arguments, keys, UI_HELP, switches=("open",))
    if given is None:
        return
    own_arguments.call(lambda: _serve(given))


def _serve(given: Mapping[str, str]) -> None:
    from hlp.reporting.mlflow_pages import PORT, newest_page, server
    from hlp.reporting.mlflow_store import is_local

    port = given.get("port", str(PORT))
    if not port.isdecimal():
        raise InputError(f"port={port}: it is a number")
    uri = given.get("uri") or tracking_uri(given.get("work", "work"))
    page = newest_page(uri, given.get("experiment"))
    if not is_local(uri):
        _show(uri.rstrip("/") + page, given)
        return
    with server(uri, int(port)) as address:
        _show(address + page, given)
        print("Stop it with Ctrl-C.", flush=True)
        try:
            while True:
                time.sleep(3600)
        except KeyboardInterrupt:
            return


def _show(page: str, given: Mapping[str, str]) -> None:
    print(f"Runs: {page}", flush=True)
    # Without a screen, some systems would open a browser made of text in this terminal.
    screen = sys.platform in ("darwin", "win32") or {"DISPLAY", "WAYLAND_DISPLAY"} & {*os.environ}
    if screen and given.get("open", "true") == "true":
        import webbrowser  # a tenth of the time of `hlp --help`

        webbrowser.open(page)


UI_HELP = """\
usage: hlp ui [experiment=NAME] [work=DIR | uri=MLFLOW] [port=5000] [open=false]

Shows the runs in MLflow: the list of runs of the newest experiment, or of the
one named. For a local database this starts MLflow's server, for this machine
alone, until Ctrl-C; of a server it prints the page.

  work   folder of the runs, as for `hlp run` (work)
  uri    address of the runs (MLFLOW_TRACKING_URI, or sqlite:///DIR/mlflow.db)
  open   false: print the address only, and open no browser

hlp ui                                    the newest experiment
hlp ui experiment=fig9b port=5001         another one, at another port"""
