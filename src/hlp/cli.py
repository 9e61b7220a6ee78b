"""`hlp COMMAND [overrides]`: the command line. Nothing heavy is imported before it is needed."""

from __future__ import annotations

import logging
import os
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import hlp

if TYPE_CHECKING:
    from omegaconf import DictConfig


def main(arguments: Sequence[str] | None = None) -> None:
    """Run one command; exits with 0, 1 after an error and 2 where no such command exists.

    `HLP_TRACEBACK=1` shows where an error came from instead of one line that says what it is.
    """
    given = list(sys.argv[1:] if arguments is None else arguments)
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


def run(config: DictConfig) -> None:
    """Build everything the composed configuration names, then run every stage and score."""
    from hydra.core.hydra_config import HydraConfig

    config.output = HydraConfig.get().runtime.output_dir  # an arm of a sweep has its own

    from hlp.pipeline import build, runner

    runner.run(build.build_run(config), Path(config.output))


@dataclass(frozen=True)
class _Command:
    call: Callable[[Sequence[str]], None]
    summary: str


def _usage() -> str:
    lines = [f"  {name:<8} {command.summary}" for name, command in COMMANDS.items()]
    return "\n".join(
        ["usage: hlp COMMAND [overrides]", "", *lines, "", "`hlp COMMAND --help` says more."]
    )


def _set_environment() -> None:
    os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")  # spinning costs 20x on shared cores
    os.environ.setdefault("MPLBACKEND", "Agg")
    os.environ["HYDRA_FULL_ERROR"] = "1"  # errors reach us whole; `_fail` shortens them


def _run_command(arguments: Sequence[str]) -> None:
    import hydra
    from hydra.errors import HydraException
    from omegaconf.errors import OmegaConfBaseException

    sys.argv = ["hlp run", *arguments]  # Hydra takes no other way
    app = hydra.main(version_base="1.3", config_path=str(config_folder()), config_name="config")
    try:
        app(_job)()
    except (HydraException, OmegaConfBaseException, ValueError, OSError) as error:
        _fail(error)
    except KeyboardInterrupt:
        print("hlp: interrupted; the same command goes on from here", file=sys.stderr)
        sys.exit(130)  # as shells have it


def _job(config: DictConfig) -> None:
    """One run. In a sweep an error is logged where it happens, and the other arms go on."""
    from hydra.core.hydra_config import HydraConfig
    from hydra.types import RunMode

    try:
        run(config)
    except (ValueError, OSError) as error:
        if HydraConfig.get().mode == RunMode.RUN:
            _fail(error)
        logging.getLogger(__name__).error("%s: %s", config.output, _in_words(error))
        raise


def _report_command(arguments: Sequence[str]) -> None:
    try:
        given = _key_values(arguments, ("experiment", "output", "format"))
    except ValueError as error:
        print(f"hlp report: {error}\n\n{REPORT_HELP}", file=sys.stderr)
        sys.exit(2)
    if given is None:
        print(REPORT_HELP)
        return
    from hlp.reporting.tables import report

    folder = Path(given.get("output") or Path("outputs", given.get("experiment", "")))
    try:
        print(report(folder, given.get("format", "text")))
    except (ValueError, OSError) as error:
        _fail(error)


def _key_values(arguments: Sequence[str], known: Sequence[str]) -> dict[str, str] | None:
    """KEY=VALUE arguments as a mapping; None where help is asked for."""
    if {"-h", "--help"} & set(arguments):
        return None
    pairs = [argument.partition("=")[::2] for argument in arguments]
    for argument, (key, value) in zip(arguments, pairs, strict=True):
        if key not in known or not value:
            raise ValueError(f"cannot use '{argument}'; it takes {', '.join(known)}")
    return dict(pairs)


def config_folder() -> Path:
    """Folder of the configuration: inside an installed package, or the checkout's own `conf/`."""
    package = Path(hlp.__file__).parent
    folders = (package / "conf", package.parents[1] / "conf")
    for folder in folders:
        if (folder / "config.yaml").is_file():
            return folder
    raise FileNotFoundError(f"no config.yaml in {' or '.join(map(str, folders))}: reinstall hlp")


def _in_words(error: BaseException) -> str:
    """The error and its notes without the stack; of Hydra's errors also what lies behind them."""
    from hydra.errors import HydraException

    behind = str(error.__cause__ or "").split("\n")[:1] if isinstance(error, HydraException) else []
    return "\n".join(filter(None, [str(error), *behind, *getattr(error, "__notes__", [])]))


def _fail(error: BaseException) -> None:
    if os.environ.get("HLP_TRACEBACK", "0") not in {"", "0"}:
        raise error
    print(f"hlp: {_in_words(error)}", file=sys.stderr)
    sys.exit(1)


REPORT_HELP = """\
usage: hlp report [experiment=NAME] [output=DIR] [format=text|markdown]

Tables of finished runs, with the paper's figures beside ours for LINEMOD's objects:
those below outputs/, of one experiment (outputs/NAME), or below any other folder (output=DIR)."""

COMMANDS = {
    "run": _Command(_run_command, "every stage not yet on disk, then scores (default: the demo)"),
    "report": _Command(_report_command, "tables of finished runs, the paper's figures beside ours"),
}
