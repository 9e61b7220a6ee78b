"""Sweeps (`-m`): one run per combination of values, all children of one parent run in MLflow.

A sweep that was interrupted is continued by the same command. Every `hlp run` imports this module,
so what only sweeps need is imported by its functions.

<sweep's folder>/sweep.json   overrides, ids of the parent run and of the process, status
<sweep's folder>/sweep.lock   held while the sweep runs; released by the system if it dies
<sweep's folder>/0, 1, …      results of its runs; a run with a manifest is finished
"""

import logging
import os
import traceback
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

from hydra.core.hydra_config import HydraConfig
from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.core.override_parser.types import Override
from hydra.experimental.callback import Callback
from omegaconf import DictConfig, OmegaConf

from hlp.config.composition import chosen_by_hydra, groups_of, overrides_of
from hlp.errors import DataError, HlpError, InputError, MissingFileError
from hlp.files import SWEEP, read_json, write_json
from hlp.folders import locked
from hlp.reporting.mlflow.pages import experiment_tags, short_name
from hlp.reporting.mlflow.run import MlflowRun
from hlp.reporting.mlflow.tracking import ChildRun, MlflowSettings, as_child_run, track_run
from hlp.settings import read_settings
from hlp.stages.executor_settings import ends_with

if TYPE_CHECKING:
    from hlp.studies import forecast

LOCK = "sweep.lock"
FINISHED = "FINISHED"
_logger = logging.getLogger(__name__)

# Hydra creates its callbacks itself, so `sweep_open` looks here for what they have opened.
_OPEN = ExitStack()


class SweepCallback(Callback):
    """Hydra callback that opens a sweep before its first run."""

    def on_multirun_start(self, config: DictConfig, **kwargs: Any) -> None:
        """Open the parent run: a new one, or that of the interrupted sweep in this folder."""
        try:
            _open_sweep(config)
        except HlpError as error:  # Hydra would only warn, and start the runs
            raise SystemExit(f"hlp: the sweep cannot be opened: {error}") from error
        except Exception as error:
            traceback.print_exc()
            raise SystemExit("hlp: the sweep cannot be opened") from error


def _open_sweep(config: DictConfig) -> None:
    from hlp.reporting.sweeps import short_key
    from hlp.runs.mlflow_log import run_tags
    from hlp.studies.forecast import say_forecast

    folder = Path(config.hydra.sweep.dir).absolute()
    folder.mkdir(parents=True, exist_ok=True)
    _OPEN.enter_context(locked(folder / LOCK, f"another sweep is writing into {folder}"))
    overrides = [word for word in config.hydra.overrides.task if not word.startswith("output=")]
    swept = _swept(config)
    command = " ".join(["hlp -m", *overrides])
    settings = _tracking(config)
    data = str(config.hydra.runtime.choices.get("data", ""))
    name = f"sweep of {', '.join(short_key(key) for key in swept) or 'nothing'}"
    about = {"sweep": " ".join(overrides), "output": str(folder)}
    tags = {**run_tags(groups_of(config.hydra), folder), "command": command}
    page = experiment_tags(settings.about, command, data)
    opened = settings, name, about, tags, _read(folder).get("run_id")
    tracker = _OPEN.enter_context(track_run(*opened, params=overrides_of(overrides), page=page))
    record = {
        "overrides": overrides,
        "swept": [*swept],
        "defaults": _swept_values(config, [], [*swept]),
        "run_id": tracker.run_id,
        "process": os.getpid(),
        "extents": (extents := _extents(config, swept)),
    }
    say_forecast(extents, folder, Path(config.work))
    _OPEN.enter_context(_recorded(folder, record, tracker))


@contextmanager
def sweep_open() -> Iterator[None]:
    """At the end of the block, close the sweep opened in it: FINISHED, FAILED or KILLED."""
    with _OPEN:
        yield


def unfinished_sweep(arguments: Sequence[str], folder: Path) -> Path | None:
    """The newest sweep with the same arguments below a folder, if it did not end successfully.

    None if it is still running, or if the arguments name an output folder.
    """
    overrides = [word for word in arguments if not word.startswith(("-", "hydra"))]
    if any(word.startswith("output=") for word in overrides):
        return None
    found = sorted(folder.glob(f"*/*/{SWEEP}"), key=lambda path: path.stat().st_mtime)
    for path in reversed(found):
        record = _read(path.parent)
        if record.get("overrides") == overrides:
            ended_well = record.get("status") == FINISHED
            return None if ended_well or _is_running(path.parent) else path.parent
    return None


def run_one(config: DictConfig) -> None:
    """Run one combination of a sweep as a child run, unless it is finished already.

    A data set that is absent from `data_folder` is left out with a message. Any error, also in the
    configuration, leaves a FAILED run and is raised.
    """
    from hlp.config import build
    from hlp.runs.manifest import is_finished
    from hlp.runs.mlflow_log import run_tags
    from hlp.studies.forecast import say_forecast

    hydra = HydraConfig.get()
    if not _has_data(config):
        return
    output, sweep = Path(config.output), _read(Path(hydra.sweep.dir))
    if not sweep:
        raise MissingFileError(f"no {SWEEP} in {hydra.sweep.dir}: the sweep could not be opened")
    if os.getppid() == sweep.get("process"):  # a launcher's worker on this machine
        ends_with(os.getppid())
    swept = _swept_values(config, hydra.overrides.task, sweep["swept"])
    chosen = chosen_by_hydra()
    name = short_name(swept, chosen.groups, config.name)
    place = f"{hydra.job.num}: {' '.join(f'{key}={value}' for key, value in swept.items())}"
    with as_child_run(ChildRun(name, sweep["run_id"], swept, place)):
        try:
            run = build.build_run(config, chosen)
        except Exception:  # recorded, and raised again
            values = cast(dict[str, Any], OmegaConf.to_container(config, resolve=False))
            with track_run(_tracking(config), name, values, run_tags(chosen.groups, output)):
                raise
        if is_finished(run, output):
            _logger.info("finished already: %s in %s", name, output)
            return
        run.settings.task.run(run, output)
    say_forecast(sweep["extents"], output.parent, Path(config.work))


def _has_data(config: DictConfig) -> bool:
    """Whether `data_folder`, if it is set, has the data set; absent empty frames are left out."""
    if OmegaConf.select(config, "data_folder") is None:
        return True
    folders = {key: OmegaConf.select(config, key) for key in ("data.root", "data.empty")}
    absent = {key: path for key, path in folders.items() if path and not Path(path).is_dir()}
    if "data.root" in absent:
        _logger.warning("left out: there is no folder %s", absent["data.root"])
        return False
    if "data.empty" in absent:
        _logger.warning("false alarms are not counted: there is no folder %s", absent["data.empty"])
        OmegaConf.update(config, "data.empty", None)
    return True


@contextmanager
def _recorded(folder: Path, record: dict[str, Any], tracker: MlflowRun) -> Iterator[None]:
    """Record in `sweep.json` whether the sweep ended; then its tables, figures and page.

    These are drawn after the last run has ended, also if some failed.
    """
    write_json(folder / SWEEP, {**record, "status": "RUNNING"})
    status = "STOPPED"
    try:
        try:
            yield
        except Exception:  # that of a run; it is raised again
            try:
                _draw(folder, tracker)
            except Exception:
                _logger.exception("the tables of %s could not be made", folder)
            raise
        _draw(folder, tracker)
        status = FINISHED
    finally:
        write_json(folder / SWEEP, {**record, "status": status})


def _draw(folder: Path, tracker: MlflowRun) -> None:
    from hlp.reporting.experiments import write_reports
    from hlp.reporting.page import page_or_log, write_sweep_page
    from hlp.reporting.sweep_report import describe_sweep, log_sweeps, write_sweep
    from hlp.reporting.sweeps import read_sweeps

    sweeps = read_sweeps(folder)
    if not sweeps:  # no run has begun
        return
    written = [path for sweep in sweeps for path in write_sweep(folder, sweep)]
    written += write_reports(folder)
    described = [describe_sweep(sweep, "text") for sweep in sweeps]
    page = page_or_log(write_sweep_page, folder) if any(s.finished for s in sweeps) else None
    log_sweeps(sweeps, [*written, *([page] if page else [])], tracker)
    print("\n" + "\n\n".join(described) + "\n")
    _logger.info("Written   %s (%s)", folder, ", ".join(path.name for path in written))
    if page is not None:
        _logger.info("Report    %s (open it in a browser)", page)


def _read(folder: Path) -> dict[str, Any]:
    """`sweep.json`; empty if there is none, or if it is damaged, as if the sweep were a new one."""
    if not (folder / SWEEP).is_file():
        return {}
    try:
        record = read_json(folder / SWEEP)
    except DataError as error:
        _logger.warning("%s: a new sweep begins", error)
        return {}
    return record if isinstance(record, dict) else {}


def _is_running(folder: Path) -> bool:
    try:
        with locked(folder / LOCK, "it is running"):
            return False
    except InputError:
        return True


def _swept(config: DictConfig) -> dict[str, Override]:
    """What has several values on the command line or in `hydra.sweeper.params`, by its key."""
    given = OmegaConf.select(config, "hydra.sweeper.params") or {}
    overrides = [*(f"{key}={value}" for key, value in given.items()), *config.hydra.overrides.task]
    parsed = OverridesParser.create().parse_overrides(overrides)
    return {own.key_or_group: own for own in parsed if own.is_sweep_override()}


def _extents(config: DictConfig, swept: Mapping[str, Override]) -> list["forecast.Extent"]:
    """`extent_of` each data set that is there, of a sweep over `data.root` alone; else none."""
    from hlp.data.bop import BopSettings
    from hlp.studies.forecast import extent_of

    found: list[forecast.Extent] = []
    if [*swept] == ["data.root"] and config.data.name == "bop":
        for root in swept["data.root"].sweep_string_iterator():
            own = OmegaConf.merge(config, {"data": {"root": root}}).data
            values = cast(dict[str, Any], OmegaConf.to_container(own, resolve=True))
            with suppress(HlpError, FileNotFoundError):  # its run says what is wrong
                found.append(extent_of(read_settings(BopSettings, values, "data"), config.frames))
    return found


def _swept_values(
    config: DictConfig, overrides: Sequence[str], keys: Sequence[str]
) -> dict[str, str]:
    """A configuration's values of these keys; of a group, the name of its file."""
    parsed = OverridesParser.create().parse_overrides([*overrides])
    named = {override.key_or_group: override for override in parsed}
    values = {}
    for key in keys:
        value = OmegaConf.select(config, key)
        if value is None or isinstance(value, DictConfig):  # some groups have no node
            if key in named:
                value = named[key].get_value_element_as_str()
            elif "hydra" in config:  # it is composed without the sweep
                value = config.hydra.runtime.choices.get(key, value)
        values[key] = str(value)
    return values


def _tracking(config: DictConfig) -> MlflowSettings:
    values = {str(key): str(value) for key, value in config.reporting.items()}
    return read_settings(MlflowSettings, values, "reporting")
