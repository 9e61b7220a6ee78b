"""Composing the configuration with Hydra, for the commands that take its keys and groups."""

import logging
import sys
from collections.abc import Callable, Sequence
from pathlib import Path

import hydra
from hydra import compose, initialize_config_dir
from hydra.core.hydra_config import HydraConfig
from hydra.types import RunMode
from omegaconf import DictConfig

from hlp.commands import MULTIRUN
from hlp.commands.ending import fail, fails_in_one_line, in_words
from hlp.config.typed_defaults import provide_defaults
from hlp.errors import HlpError, InputError, is_expected
from hlp.files import config_folder as config_folder
from hlp.studies.sweep import sweep_open

_ALONE = (MULTIRUN, {"-c", "--cfg"}, {"-i", "--info"}, {"-r", "--run"})
_OPTIONS_WITH_VALUE = {
    "--cfg", "-c", "--info", "-i", "--package", "-p", "--config-dir", "-cd", "--config-name", "-cn",
    "--config-path", "-cp", "--experimental-rerun",
}  # fmt: skip


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
    app = hydra.main(
        version_base="1.3", config_path=str(folder or config_folder()), config_name="config"
    )
    with fails_in_one_line():
        # The only way to pass arguments to Hydra.
        sys.argv = [f"hlp {command}".strip(), *_overrides_first(arguments)]
        with sweep_open():
            app(lambda config: _job(config, task))()


def _overrides_first(arguments: Sequence[str]) -> list[str]:
    """The arguments in an order that Hydra takes: it refuses options among overrides.

    Raises InputError for options that exclude each other.
    """
    given = [sorted(names & {*arguments})[0] for names in _ALONE if names & {*arguments}]
    if len(given) > 1:
        raise InputError(f"{' and '.join(given)} exclude each other: leave one out")
    overrides, options = list[str](), list[str]()
    for before, argument in zip(["", *arguments], arguments, strict=False):
        is_option = argument.startswith("-") or before in _OPTIONS_WITH_VALUE
        (options if is_option else overrides).append(argument)
    return [*overrides, *options]


def _job(config: DictConfig, task: Callable[[DictConfig], None]) -> None:
    """Run one task. In a sweep an error is logged, and the other runs continue."""
    try:
        task(config)
    except (HlpError, OSError) as error:
        if not is_expected(error):
            raise
        if HydraConfig.get().mode == RunMode.RUN:
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
