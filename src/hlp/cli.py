"""`hlp COMMAND [overrides]`: the command line. Nothing heavy is imported before it is needed."""

import os
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from importlib import import_module

import hlp
from hlp.commands import MULTIRUN, completion, help_text
from hlp.commands.ending import fails_in_one_line, messages_on, stops_in_one_line

_HELP = {"-h", "--help"}


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
        command = COMMANDS[name]
        continues = command.continues(rest)
        with stops_in_one_line(continues), messages_on(command.messages), fails_in_one_line():
            if _HELP & {*rest} or (command.needs_arguments and not rest):
                print(help_text(name, rest))
            else:
                function = getattr(import_module(f"hlp.commands.{command.module}"), name)
                function(rest)
    else:
        from hlp.commands.arguments import nearest

        hint = nearest(name, COMMANDS)
        print(f"hlp: there is no command '{name}'{hint}\n\n{_usage()}", file=sys.stderr)
        sys.exit(2)


@dataclass(frozen=True)
class _Command:
    """A function of its name in a module of `hlp.commands`."""

    module: str
    summary: str
    goes_on: bool = True
    """Whether the same command, called again, goes on where it was stopped."""
    needs_arguments: bool = False
    messages: str = "stdout"
    """The stream of HLP's messages; none where Hydra sets up the logging."""

    def continues(self, arguments: Sequence[str]) -> bool:
        """Whether it goes on with these arguments: a sequence is tracked from its start."""
        if self.module != "predict":
            return self.goes_on
        named = any(argument.startswith("output=") for argument in arguments)
        return named and "track=true" not in arguments


def _usage() -> str:
    lines = [f"  {name:<9} {command.summary}" for name, command in COMMANDS.items()]
    return "\n".join(
        [
            "usage: hlp COMMAND [overrides]",
            "       hlp -m [overrides]   (a sweep)",
            "",
            *lines,
            "",
            "hlp run                                   the demo, then open its report.html",
            "hlp -m refinement=pso,icp                 a sweep of two refiners",
            "",
            "See `hlp COMMAND --help` for the options of a command.",
            'Completion of commands and keys:  eval "$(hlp -sc install=bash)"  (or zsh);',
            "in fish:  hlp -sc install=fish | source",
        ]
    )


def _set_environment() -> None:
    os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")  # spinning costs 20x on shared cores
    os.environ.setdefault("MPLBACKEND", "Agg")
    # Of the helper of multiprocessing that cleans up after workers that had to be stopped.
    given = os.environ.get("PYTHONWARNINGS", "").split(",")
    filters = dict.fromkeys([*filter(None, given), "ignore:resource_tracker"])
    os.environ["PYTHONWARNINGS"] = ",".join(filters)
    os.environ.setdefault("OPENCV_LOG_LEVEL", "ERROR")  # what cannot be read is said once, by us
    os.environ["HYDRA_FULL_ERROR"] = "1"  # Hydra raises errors unchanged; `fail` shortens them


COMMANDS = {
    "run": _Command("run", "learn, find and score (default: the demo)", messages=""),
    "learn": _Command(
        "learn", "learn your own objects from their CAD models", needs_arguments=True
    ),
    "predict": _Command(
        "predict", "poses of learnt objects in your own frames", needs_arguments=True
    ),
    "live": _Command(
        "live",
        "poses in the images of a camera, as they come",
        goes_on=False,
        needs_arguments=True,
        messages="stderr",
    ),
    "objects": _Command(
        "objects", "what is learnt: list, show, remove, export", goes_on=False, needs_arguments=True
    ),
    "doctor": _Command(
        "doctor", "what is wrong with data, learnt objects or this machine", goes_on=False
    ),
    "report": _Command(
        "report",
        "tables and pages of finished runs, with the paper's numbers",
        goes_on=False,
        messages="stderr",
    ),
    "runs": _Command(
        "report", "the runs in outputs/, with their main figures", goes_on=False, messages="stderr"
    ),
    "ui": _Command("report", "the runs in a browser, by MLflow", goes_on=False),
    "upload": _Command("report", "send runs to an MLflow server that was unreachable"),
    "bench": _Command("run", "time and memory of every stage on this machine", messages=""),
    "search": _Command("run", "search for the best settings within a time limit", messages=""),
    "download": _Command(
        "folders", "public data sets in a form that HLP reads", needs_arguments=True
    ),
    "notebooks": _Command("folders", "copy the tutorial notebooks into a folder", goes_on=False),
    "clean": _Command("folders", "stage outputs that can be removed", goes_on=False),
}
