"""Composing the configuration with Hydra, for the commands that take its keys and groups."""

import logging
import shutil
import sys
from collections.abc import Callable, Sequence
from pathlib import Path

import hydra
from hydra import compose, initialize_config_dir
from hydra.core.global_hydra import GlobalHydra
from hydra.core.hydra_config import HydraConfig
from hydra.errors import HydraException
from hydra.types import RunMode
from omegaconf import DictConfig, OmegaConf
from omegaconf.errors import OmegaConfBaseException
from yaml import MarkedYAMLError

from hlp.commands import MULTIRUN
from hlp.commands.arguments import nearest
from hlp.commands.ending import fail, fails_in_one_line, in_words, is_foreseen
from hlp.config.composition import provide_defaults
from hlp.errors import InputError, is_expected
from hlp.files import config_folder as config_folder
from hlp.studies.sweep import sweep_open

_ALONE = {*MULTIRUN, "-c", "--cfg", "-i", "--info", "-r", "--run"}


def compose_config(*overrides: str, folder: Path | None = None) -> DictConfig:
    """The configuration of `hlp run` with these overrides, for notebooks and scripts.

    `folder` holds another `config.yaml` than HLP's own. Raises Hydra's errors for an override of an
    unknown key or group.
    """
    provide_defaults()
    with initialize_config_dir(str((folder or config_folder()).absolute()), version_base="1.3"):
        return compose("config", overrides=list(overrides))


def compose_and_call(
    command: str,
    arguments: Sequence[str],
    task: Callable[[DictConfig], None],
    folder: Path | None = None,
) -> None:
    """Compose the configuration, that in `folder` or HLP's own, and call the task with it.

    An expected error ends the process with one line; see `fails_in_one_line`.
    """
    provide_defaults()
    place = str(folder or config_folder())
    app = hydra.main(version_base="1.3", config_path=place, config_name="config")
    with fails_in_one_line():
        alone = [word for word in arguments if word in _ALONE]
        if len(alone) > 1:
            raise InputError(f"{' and '.join(alone)} exclude each other: leave one out")
        # The only way to pass arguments to Hydra, which refuses options among overrides.
        sys.argv = [f"hlp {command}".strip(), *sorted(arguments, key=_is_of_options)]
        with sweep_open():
            app(lambda config: _job(config, task))()


def _is_of_options(word: str) -> bool:
    """Whether a word is an option or the value of one, and no override (KEY=VALUE, ~KEY)."""
    return word.startswith("-") or not ("=" in word or word.startswith("~"))


def _job(config: DictConfig, task: Callable[[DictConfig], None]) -> None:
    """Run one task. In a sweep an error is logged, and the other runs continue."""
    try:
        task(config)
    except Exception as error:
        if not is_foreseen(error):
            raise
        if HydraConfig.get().mode == RunMode.RUN:
            folder = Path(HydraConfig.get().runtime.output_dir)
            if {path.name for path in folder.glob("*")} <= {".hydra", "hlp.log"}:
                shutil.rmtree(folder, ignore_errors=True)  # of a run that has not begun
            fail(error)  # here, since Hydra adds a line to what passes through it
        logging.getLogger(__name__).error("%s: %s", config.output, in_words(error))
        raise


class LogFile(logging.FileHandler):
    """The log file in a run's output folder, which is silent about a full disk.

    Python's own prints a traceback for every message that it cannot write. What matters is what the
    run says, when it cannot write its results either.
    """

    def handleError(self, record: logging.LogRecord) -> None:  # noqa: N802
        """Called by `emit` while it handles an error."""
        error = sys.exc_info()[1]
        if error is None or not is_expected(error):
            super().handleError(record)


# Plugins of Hydra's with launchers, and the extra that installs each.
_EXTRAS = {"joblib": "joblib", "submitit": "slurm"}


def hydra_in_words(error: BaseException) -> str:
    """An error of Hydra's in one line, with what may have been meant; other ones as they are."""
    text = str(error) or type(error).__name__
    first = text.partition("\n")[0]
    if isinstance(error, MarkedYAMLError):
        mark = error.problem_mark or error.context_mark
        place = f"{mark.name}, line {mark.line + 1}" if mark is not None else "a configuration"
        return f"{place} is not YAML: {error.problem or error.context}"
    if isinstance(error, OmegaConfBaseException):
        return f"{error.full_key}: {first}" if error.full_key else first
    if not isinstance(error, HydraException):
        return text
    if (override := getattr(error, "override", None)) is not None:
        return (
            f"cannot read '{override}' ({first}): settings are given as KEY=VALUE; a value with "
            "signs such as []{}(), or spaces is quoted twice: KEY='\"VALUE\"'"
        )
    words = " ".join(text.partition("Config search path")[0].split())
    for plugin, extra in _EXTRAS.items():
        if f"'hydra/launcher/{plugin}" in words:
            return f"this launcher needs the extra '{extra}': pip install 'hlp[{extra}]'"
    if not first.startswith("Could not override"):
        return words.removeprefix("In 'config': ")
    said, key, known = first.rstrip("."), first.split("'")[1], _all_keys()
    if key in known:
        return f"{said}: the chosen {key.partition('.')[0]} has no such key"
    return f"{said}{nearest(key, known) or ':'} `hlp run --cfg job` prints all keys"


def _all_keys() -> list[str]:
    """All keys of the default configuration, and its groups."""
    from hlp.runs.manifest import entries

    GlobalHydra.instance().clear()
    plain = OmegaConf.to_container(compose_config(), resolve=False)
    return [key for key, _ in entries(plain) if "[" not in key]
