"""`hlp COMMAND [overrides]`: the command line. Nothing heavy is imported before it is needed."""

import os
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import hlp
from hlp.commands import (
    bench,
    clean,
    completion,
    doctor,
    download,
    learn,
    live,
    notebooks,
    objects,
    predict,
    report,
    run,
    runs,
    search,
    ui,
    upload,
)
from hlp.commands.composing import MULTIRUN
from hlp.commands.ending import stops_in_one_line
from hlp.commands.nearest import nearest


def main(arguments: Sequence[str] | None = None) -> None:
    """Run one command. Exits with 0, with 1 after an error, with 2 if there is no such command.

    Exits with 130 after Ctrl-C (SIGINT) and with 143 after SIGTERM, in both cases with one line.

    `HLP_TRACEBACK=1` shows an error's traceback instead of one line.
    """
    given = list(sys.argv[1:] if arguments is None else arguments)
    if given and given[0] in MULTIRUN:
        given = ["run", *given]
    name = given[0] if given else "--help"
    if name in {"-h", "--help"}:
        print(_usage())
    elif name == "--version":
        print(f"hlp {hlp.__version__}")
    elif name in completion.OPTIONS:
        _set_environment()
        completion.command(given, list(COMMANDS))
    elif name in COMMANDS:
        _set_environment()
        with stops_in_one_line(COMMANDS[name].continues(given[1:])):
            COMMANDS[name].call(given[1:])
    else:
        hint = nearest(name, COMMANDS)
        print(f"hlp: there is no command '{name}'{hint}\n\n{_usage()}", file=sys.stderr)
        sys.exit(2)


def _always(arguments: Sequence[str]) -> bool:
    return True


def _never(arguments: Sequence[str]) -> bool:
    return False


@dataclass(frozen=True)
class _Command:
    call: Callable[[Sequence[str]], None]
    summary: str
    continues: Callable[[Sequence[str]], bool] = _always
    """Whether the same command with these arguments, called again, goes on where it was stopped."""


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
    given = [each for each in os.environ.get("PYTHONWARNINGS", "").split(",") if each]
    os.environ["PYTHONWARNINGS"] = ",".join(dict.fromkeys([*given, "ignore:resource_tracker"]))
    os.environ.setdefault("OPENCV_LOG_LEVEL", "ERROR")  # what cannot be read is said once, by us
    os.environ["HYDRA_FULL_ERROR"] = "1"  # Hydra raises errors unchanged; `fail` shortens them


COMMANDS = {
    "run": _Command(run.command, "learn, find and score (default: the demo)"),
    "learn": _Command(learn.command, "learn your own objects from their CAD models"),
    "predict": _Command(
        predict.command, "poses of learnt objects in your own frames", predict.continues
    ),
    "live": _Command(live.command, "poses in the images of a camera, as they come", _never),
    "objects": _Command(objects.command, "what is learnt: list, show, remove, export", _never),
    "doctor": _Command(
        doctor.command, "what is wrong with data, learnt objects or this machine", _never
    ),
    "report": _Command(
        report.command, "tables and pages of finished runs, with the paper's numbers", _never
    ),
    "runs": _Command(runs.command, "what lies in outputs/, with the main figures", _never),
    "ui": _Command(ui.command, "the runs in a browser, by MLflow", _never),
    "upload": _Command(upload.command, "send runs to an MLflow server that was unreachable"),
    "bench": _Command(bench.command, "time and memory of every stage on this machine"),
    "search": _Command(search.command, "search for the best settings within a time limit"),
    "download": _Command(download.command, "public data sets in a form that HLP reads"),
    "notebooks": _Command(notebooks.command, "copy the notebooks that teach into a folder", _never),
    "clean": _Command(clean.command, "outputs of stages that may go, and their sizes", _never),
}
