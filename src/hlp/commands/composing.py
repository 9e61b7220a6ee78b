"""Shared by all commands: composing the configuration with Hydra, arguments, error messages."""

from __future__ import annotations

import logging
import os
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, NoReturn

from hlp.commands.nearest import nearest
from hlp.errors import HlpError, InputError, is_expected
from hlp.files import config_folder as config_folder

if TYPE_CHECKING:
    from omegaconf import DictConfig

MULTIRUN = {"-m", "--multirun"}
HELP = {"-h", "--help"}
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
    from hydra import compose, initialize_config_dir

    from hlp.config.typed_defaults import provide_defaults

    provide_defaults()
    with initialize_config_dir(str((folder or config_folder()).absolute()), version_base="1.3"):
        return compose("config", overrides=list(overrides))


def compose_and_call(
    command: str,
    arguments: Sequence[str],
    task: Callable[[DictConfig], None],
    folder: Path,
) -> None:
    """Compose the configuration in a folder and call the task with it.

    After an error that HLP expects (`hlp.errors`), an error of Hydra's, a file that is no YAML, or
    an error of the system such as a full disk, the process prints one line and exits with 1. Any
    other exception is a bug and is raised.
    """
    import hydra
    from hydra.errors import HydraException
    from omegaconf.errors import OmegaConfBaseException
    from yaml import YAMLError

    from hlp.config.typed_defaults import provide_defaults
    from hlp.studies.sweep import sweep_open

    provide_defaults()
    app = hydra.main(version_base="1.3", config_path=str(folder), config_name="config")
    try:
        # The only way to pass arguments to Hydra.
        sys.argv = [f"hlp {command}".strip(), *_overrides_first(arguments)]
        with sweep_open():
            app(lambda config: _job(config, task))()
    except (HydraException, OmegaConfBaseException, YAMLError, HlpError) as error:
        fail(error)
    except OSError as error:
        if not is_expected(error):
            raise
        fail(error)


def _overrides_first(arguments: Sequence[str]) -> list[str]:
    """The arguments in an order that Hydra takes: it refuses options among overrides.

    Raises InputError for options that exclude each other.
    """
    given = [sorted(names & {*arguments})[0] for names in _ALONE if names & {*arguments}]
    if len(given) > 1:
        raise InputError(f"{' and '.join(given)} exclude each other: leave one out")
    overrides, options = list[str](), list[str]()
    for before, each in zip(["", *arguments], arguments, strict=False):
        is_option = each.startswith("-") or before in _OPTIONS_WITH_VALUE
        (options if is_option else overrides).append(each)
    return [*overrides, *options]


def _job(config: DictConfig, task: Callable[[DictConfig], None]) -> None:
    """Run one task. In a sweep an error is logged, and the other runs continue."""
    from hydra.core.hydra_config import HydraConfig
    from hydra.types import RunMode

    try:
        task(config)
    except (HlpError, OSError) as error:
        if not is_expected(error):
            raise
        if HydraConfig.get().mode == RunMode.RUN:
            fail(error)  # here, since Hydra adds a line to what passes through it
        logging.getLogger(__name__).error("%s: %s", config.output, _in_words(error))
        raise


def key_values(
    arguments: Sequence[str], known: Sequence[str], usage: str, switches: Sequence[str] = ()
) -> dict[str, str] | None:
    """KEY=VALUE arguments as a mapping; None after `usage` was printed since help is asked for.

    A switch is true or false. For an argument of another form or with an unknown key, the process
    prints what is wrong and the usage, whose first line begins `usage: hlp NAME`, and exits with 2.
    """
    if HELP & set(arguments):
        print(usage)
        return None
    pairs = [argument.partition("=")[::2] for argument in arguments]
    for argument, (key, value) in zip(arguments, pairs, strict=True):
        wrong = ""
        if key not in known or not value:
            hint = "" if key in known else nearest(key, known)
            wrong = f"cannot use '{argument}'{hint or ';'} it takes {', '.join(known)}"
        elif key in switches and value not in ("true", "false"):
            wrong = f"{argument}: it is true or false"
        if wrong:
            print(f"hlp {usage.split()[2]}: {wrong}\n\n{usage}", file=sys.stderr)
            sys.exit(2)
    return dict(pairs)


def fail(error: BaseException) -> NoReturn:
    """Print the error's message and exit with 1; with HLP_TRACEBACK set, raise the error."""
    if os.environ.get("HLP_TRACEBACK", "0") not in {"", "0"}:
        raise error
    print(f"hlp: {_in_words(error)}", file=sys.stderr)
    sys.exit(1)


def _in_words(error: BaseException) -> str:
    """The message of an error and its notes; Hydra's in one sentence, with its cause's message."""
    from hydra.errors import HydraException
    from omegaconf.errors import OmegaConfBaseException
    from yaml import YAMLError

    if not isinstance(error, HydraException | OmegaConfBaseException | YAMLError):
        return "\n".join([str(error), *getattr(error, "__notes__", [])])
    from hlp.commands.hydra_errors import hydra_in_words

    words = hydra_in_words(error)
    behind = str(error.__cause__ or "").split("\n")[:1] if words == str(error) else []
    return "\n".join(filter(None, [words, *behind, *getattr(error, "__notes__", [])]))
