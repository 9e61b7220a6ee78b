"""`hlp COMMAND [overrides]`: the command line. Nothing heavy is imported before it is needed."""

from __future__ import annotations

import logging
import os
import sys
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, NoReturn

import hlp

if TYPE_CHECKING:
    from omegaconf import DictConfig


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


def run(config: DictConfig, manifest: Path | None = None) -> None:
    """Build everything the composed configuration names, then do its task with it.

    With a `manifest`, whose configuration it is, the data and the poses are compared with it.
    """
    from hydra.core.hydra_config import HydraConfig
    from hydra.types import RunMode

    config.output = HydraConfig.get().runtime.output_dir  # an arm of a sweep has its own

    from hlp.pipeline import build, repeat, sweep, tasks

    if HydraConfig.get().mode == RunMode.MULTIRUN:
        sweep.run_arm(config)
    elif manifest is not None:
        repeat.run_again(build.build_run(config), manifest, Path(config.output))
    else:
        tasks.run_task(build.build_run(config), Path(config.output))


def predict(config: DictConfig) -> None:
    """Poses of a user's own object in their own frames; what is learnt is kept for next time."""
    from hydra.core.hydra_config import HydraConfig
    from omegaconf import OmegaConf

    for key in OWN_FILES:
        if OmegaConf.is_missing(config.data, key):
            raise ValueError(f"{key} is not set: give {key}=…, see `hlp predict --help`")
    config.output = HydraConfig.get().runtime.output_dir

    from hlp.pipeline import build, prediction

    prediction.predict(build.build_run(config), Path(config.output))


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
    os.environ["HYDRA_FULL_ERROR"] = "1"  # errors reach us whole; `_fail` shortens them


def _run_command(arguments: Sequence[str]) -> None:
    from hlp.pipeline.sweep import unfinished_sweep

    if any(each.startswith(MANIFEST) for each in arguments):
        _repeat(arguments)
        return
    folder = unfinished_sweep(arguments, Path("outputs")) if MULTIRUN & {*arguments} else None
    if folder is not None:
        print(f"going on with the sweep in {folder}")
        arguments = [*arguments, f"output='{folder}'"]
    _compose_and_call("run", arguments, run, config_folder())


def _repeat(arguments: Sequence[str]) -> None:
    from hlp.pipeline.repeat import config_of

    overrides = [each for each in arguments if not each.startswith(MANIFEST)]
    named = [each.removeprefix(MANIFEST) for each in arguments if each.startswith(MANIFEST)]
    manifest = Path(named[-1]).expanduser()
    try:
        config = config_of(manifest, overrides, config_folder())
    except (ValueError, OSError) as error:
        _fail(error)
    with tempfile.TemporaryDirectory() as folder:
        Path(folder, "config.yaml").write_text(config)
        _compose_and_call("run", overrides, lambda each: run(each, manifest), Path(folder))


def _predict_command(arguments: Sequence[str]) -> None:
    if not arguments or {"-h", "--help"} & set(arguments):
        print(PREDICT_HELP)
        return
    overrides = [_data_override(argument) for argument in arguments]
    _compose_and_call("predict", ["experiment=predict", *overrides], predict, config_folder())


def _data_override(argument: str) -> str:
    """`model=FILE` as Hydra's override of `data.model`; paths may hold what Hydra's have not."""
    key, _, value = argument.partition("=")
    if key not in (*OWN_FILES, *OWN_UNITS):
        return argument
    if key in OWN_FILES and not value.startswith(("[", "'", '"')):
        value = "'" + os.path.expanduser(value).replace("'", "\\'") + "'"
    return f"data.{key}={value}"


def _compose_and_call(
    command: str,
    arguments: Sequence[str],
    task: Callable[[DictConfig], None],
    folder: Path,
) -> None:
    """Compose the configuration that lies in a folder and do the task with it."""
    import hydra
    from hydra.errors import HydraException
    from omegaconf.errors import OmegaConfBaseException

    from hlp.pipeline.sweep import sweep_open

    sys.argv = [f"hlp {command}", *arguments]  # Hydra takes no other way
    app = hydra.main(version_base="1.3", config_path=str(folder), config_name="config")
    try:
        with sweep_open():
            app(lambda config: _job(config, task))()
    except (HydraException, OmegaConfBaseException, ValueError, OSError) as error:
        _fail(error)
    except KeyboardInterrupt:
        print("hlp: interrupted; the same command goes on from here", file=sys.stderr)
        sys.exit(130)  # as shells have it


def _job(config: DictConfig, task: Callable[[DictConfig], None]) -> None:
    """One task. In a sweep an error is logged where it happens, and the other arms go on."""
    from hydra.core.hydra_config import HydraConfig
    from hydra.types import RunMode

    try:
        task(config)
    except (ValueError, OSError) as error:
        if HydraConfig.get().mode == RunMode.RUN:
            _fail(error)
        logging.getLogger(__name__).error("%s: %s", config.output, _in_words(error))
        raise


def _report_command(arguments: Sequence[str]) -> None:
    try:
        given = _key_values(arguments, ("experiment", "output", "format", "runs", "uri"))
    except ValueError as error:
        print(f"hlp report: {error}\n\n{REPORT_HELP}", file=sys.stderr)
        sys.exit(2)
    if given is None:
        print(REPORT_HELP)
        return
    from hlp.reporting.comparison import compare
    from hlp.reporting.tables import report

    layout = given.get("format", "text")
    folder = Path(given.get("output") or Path("outputs", given.get("experiment", "")))
    try:
        if "runs" in given:
            print(compare(given["runs"], given.get("uri", MLFLOW), layout))
        else:
            print(report(folder, layout))
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


def _fail(error: BaseException) -> NoReturn:
    if os.environ.get("HLP_TRACEBACK", "0") not in {"", "0"}:
        raise error
    print(f"hlp: {_in_words(error)}", file=sys.stderr)
    sys.exit(1)


REPORT_HELP = """\
usage: hlp report [experiment=NAME] [output=DIR] [format=text|markdown]
       hlp report 'runs=[A,B]' [uri=MLFLOW]

Tables of finished runs, with the paper's figures beside ours for LINEMOD's objects:
those below outputs/, of one experiment (outputs/NAME), or below any other folder (output=DIR).

runs=[A,B] compares two runs target by target: the difference of their recalls with its interval,
McNemar's test, and which targets flipped. Each is an output folder, or a run's id in MLflow
(uri=sqlite:///work/mlflow.db)."""

MLFLOW = "sqlite:///work/mlflow.db"

USAGE = ("usage: hlp COMMAND [overrides]", "       hlp -m [overrides]   (a sweep of runs)")
MANIFEST = "manifest="
MULTIRUN = {"-m", "--multirun"}
OWN_FILES = ("model", "rgb", "depth", "intrinsics")
OWN_UNITS = ("mesh_scale", "depth_scale")

PREDICT_HELP = """\
usage: hlp predict model=FILE rgb=PATH depth=PATH intrinsics=FILE|[fx,fy,cx,cy] [overrides]

Poses of your own object in your own RGB-D frames, from its CAD model alone.

  model        triangle mesh of the object (PLY, OBJ, STL …), in millimetres
  rgb          a colour image, or a folder of them
  depth        its 16-bit depth PNG, or a folder with the same names; registered to the colour
  intrinsics   JSON with cam_K (nine numbers) or fx, fy, cx, cy, and depth_scale; or the numbers

  mesh_scale   metres per unit of the model (0.001; 1 for a model in metres)
  depth_scale  millimetres per unit of the depth images (the JSON's, else 1)
  output       folder of the results (outputs/predict/TIME)
  work         what is learnt about the object is kept there (work)

hlp predict model=bracket.ply rgb=frame.png depth=frame_depth.png intrinsics=camera.json
hlp predict model=bracket.ply rgb=rgb/ depth=depth/ "intrinsics=[572.4,573.6,325.3,242.0]"

The first call learns the object, which takes minutes; later ones find it at once. It learns better
with photographs and RGB-D frames of places like yours, without the object:
  data.photographs=FOLDER   data.rooms=FOLDER (with rgb/, depth/ and camera.json)
All of `hlp run`'s groups and keys can be changed as well, e.g. refinement=icp or method=paper.

Written into the output folder: poses.csv (BOP's format), poses.json and panels/, a picture of each
frame. R and t (mm) map the object's coordinates to the camera's: x right, y down, z forward."""

COMMANDS = {
    "run": _Command(_run_command, "every stage not yet on disk, then scores (default: the demo)"),
    "predict": _Command(_predict_command, "poses of your own object in your own frames"),
    "report": _Command(_report_command, "tables of finished runs, the paper's figures beside ours"),
}
