"""`hlp COMMAND [overrides]`: the command line. Nothing heavy is imported before it is needed."""

import os
import sys
from collections.abc import Sequence
from importlib import import_module

import hlp
from hlp.commands import MULTIRUN, completion, help_text
from hlp.commands.ending import fails_in_one_line, messages_on, stops_in_one_line

_HELP = {"-h", "--help"}


COMMANDS = {
    "run": "learn, find and score (default: the demo)",
    "learn": "learn your own objects from their CAD models",
    "predict": "poses of learnt objects in your own frames",
    "live": "poses in the images of a camera, as they come",
    "objects": "what is learnt: list, show, remove, export",
    "doctor": "what is wrong with data, learnt objects or this machine",
    "report": "tables and pages of finished runs, with the paper's numbers",
    "runs": "the runs in outputs/, with their main figures",
    "ui": "the runs in a browser, by MLflow",
    "upload": "send runs to an MLflow server that was unreachable",
    "bench": "time and memory of every stage on this machine",
    "search": "search for the best settings within a time limit",
    "download": "public data sets in a form that HLP reads",
    "notebooks": "copy the tutorial notebooks into a folder",
    "clean": "stage outputs that can be removed",
}
"""The commands: functions of their names in `hlp.commands`."""
_MODULES = {
    **dict.fromkeys(("bench", "search"), "run"),
    "live": "predict",
    **dict.fromkeys(("runs", "ui", "upload"), "report"),
    **dict.fromkeys(("download", "notebooks", "clean"), "folders"),
}
"""The module of a command, where it has not its name."""
_NEED_ARGUMENTS = {"learn", "predict", "live", "objects", "download"}
_CONTINUE = {"run", "learn", "upload", "bench", "search", "download"}
"""Commands that go on, when they are called again, where they were stopped."""
_MESSAGES = {
    **dict.fromkeys(("run", "bench", "search"), ""),  # Hydra sets up the logging
    **dict.fromkeys(("live", "report", "runs"), "stderr"),
}
"""The stream of a command's messages, where it is not standard output."""


def main(arguments: Sequence[str] | None = None) -> None:
    """Run one command. Exits with 0, with 1 after an error, with 2 if there is no such command.

    Exits with 130 after Ctrl-C (SIGINT) and with 143 after SIGTERM, in both cases with one line.

    `HLP_TRACEBACK=1` shows an error's traceback instead of one line.
    """
    given = list(sys.argv[1:] if arguments is None else arguments)
    if given and given[0] in MULTIRUN:
        given = ["run", *given]
    name, *rest = given or ["--help"]
    if name in _HELP:
        print(_usage())
    elif name == "--version":
        print(f"hlp {hlp.__version__}")
    elif name in completion.OPTIONS:
        _set_environment()
        completion.complete(given, list(COMMANDS))
    elif name in COMMANDS:
        _set_environment()
        messages = messages_on(_MESSAGES.get(name, "stdout"))
        with stops_in_one_line(name in _CONTINUE), messages, fails_in_one_line():
            if _HELP & {*rest} or (name in _NEED_ARGUMENTS and not rest):
                print(help_text(name))
            else:
                module = import_module(f"hlp.commands.{_MODULES.get(name, name)}")
                getattr(module, name)(rest)
    else:
        from hlp.commands.arguments import nearest

        hint = nearest(name, COMMANDS)
        print(f"hlp: there is no command '{name}'{hint}\n\n{_usage()}", file=sys.stderr)
        sys.exit(2)


def _usage() -> str:
    commands = "\n".join(f"  {name:<9} {summary}" for name, summary in COMMANDS.items())
    return f"""\
usage: hlp COMMAND [overrides]
       hlp -m [overrides]   (a sweep)

{commands}

hlp predict learnt=example                an object that is learnt already
hlp run                                   the demo, then open its report.html
hlp -m refinement=pso,icp                 a sweep of two refiners

See `hlp COMMAND --help` for the options of a command.
Completion of commands and keys:  eval "$(hlp -sc install=bash)"  (or zsh);
in fish:  hlp -sc install=fish | source"""


def _set_environment() -> None:
    os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")  # spinning costs 20x on shared cores
    os.environ.setdefault("MPLBACKEND", "Agg")
    # Of the helper of multiprocessing that cleans up after workers that had to be stopped.
    given = os.environ.get("PYTHONWARNINGS", "").split(",")
    filters = dict.fromkeys([*filter(None, given), "ignore:resource_tracker"])
    os.environ["PYTHONWARNINGS"] = ",".join(filters)
    os.environ.setdefault("OPENCV_IO_MAX_IMAGE_PIXELS", "200000000")  # small files may state more
    os.environ.setdefault("OPENCV_LOG_LEVEL", "ERROR")  # what cannot be read is said once, by us
    os.environ["HYDRA_FULL_ERROR"] = "1"  # Hydra raises errors unchanged; `fail` shortens them
