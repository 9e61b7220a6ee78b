"""`hlp COMMAND [overrides]`: the command line. Nothing heavy is imported before it is needed."""

import os
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import hlp
from hlp.commands import bench, predict, report, run, search
from hlp.commands.composing import MULTIRUN


def main(arguments: Sequence[str] | None = None) -> None:
    """Run one command; exits with 0, 1 after an error and 2 where no such command exists.

    `HLP_TRACEBACK=1` shows where an error came from instead of one line that says what it is.
    """
    given = list(sys.argv[1:] if arguments is None else arguments)
    if given and given[0] in MULTIRUN:
        given = ["run", *given]
    name = given[0] if given else "--help"
    if name in {"-h", "--help"}:
        print(_usage())
    elif name == "--version":
        print(f"hlp {hlp.__version__}")
    elif name in COMMANDS:
        _set_environment()
        COMMANDS[name].call(given[1:])
    else:
        print(f"hlp: there is no command '{name}'\n\n{_usage()}", file=sys.stderr)
        sys.exit(2)


@dataclass(frozen=True)
class _Command:
    call: Callable[[Sequence[str]], None]
    summary: str


def _usage() -> str:
    lines = [f"  {name:<8} {command.summary}" for name, command in COMMANDS.items()]
    return "\n".join(
        [
            "usage: hlp COMMAND [overrides]",
            "       hlp -m [overrides]   (a sweep)",
            "",
            *lines,
            "",
            "`hlp COMMAND --help` says more.",
        ]
    )


def _set_environment() -> None:
    os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")  # spinning costs 20x on shared cores
    os.environ.setdefault("MPLBACKEND", "Agg")
    os.environ["HYDRA_FULL_ERROR"] = "1"  # errors reach us whole; `fail` shortens them


COMMANDS = {
    "run": _Command(run.command, "every stage not yet on disk, then scores (default: the demo)"),
    "predict": _Command(predict.command, "poses of your own object in your own frames"),
    "report": _Command(report.command, "tables of finished runs, the paper's figures beside ours"),
    "bench": _Command(bench.command, "time and memory of every stage, on this machine"),
    "search": _Command(search.command, "the settings with the best recall within a time limit"),
}
