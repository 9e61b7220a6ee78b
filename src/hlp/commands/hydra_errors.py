"""Errors of the configuration, in overrides or YAML files, in one line that says what to do.

Hydra names file and key in its first line, which is shown; what may have been meant is added.
"""

import re
import sys
from collections.abc import Iterator, Mapping
from typing import Any

from hydra.core.global_hydra import GlobalHydra
from hydra.errors import HydraException
from omegaconf import OmegaConf
from omegaconf.errors import OmegaConfBaseException
from yaml import MarkedYAMLError

from hlp.commands.arguments import nearest
from hlp.commands.composing import compose_config

_CHOICE = re.compile(r"[\w/]+=[\w.-]+")
_NAMED = re.compile(r"'([^']+)'")
_LAUNCHERS = "hydra/launcher/"
# Launchers that come with a plugin of Hydra's, and the extra that installs it.
_EXTRAS = {"joblib": "joblib", "submitit_slurm": "slurm", "submitit_local": "slurm"}


def hydra_in_words(error: BaseException) -> str:
    """An error of Hydra's in one line; other ones as they are."""
    text = str(error) or type(error).__name__
    first, *more = text.splitlines()
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
    if first.startswith("Ambiguous"):  # a list, a text or a sweep: Hydra says what to type
        return " ".join([first, *more])
    options = [line.strip() for line in more if line.startswith("\t") and "=" not in line]
    return _with_hint(first.removeprefix("In 'config': ").rstrip("."), options)


def _with_hint(said: str, options: list[str]) -> str:
    """The message, and what may have been meant by the name that it ends with."""
    names = _NAMED.findall(said)
    launchers = [name.removeprefix(_LAUNCHERS) for name in names if name.startswith(_LAUNCHERS)]
    if launchers and launchers[-1] in _EXTRAS:
        extra = _EXTRAS[launchers[-1]]
        return (
            f"hydra/launcher={launchers[0]} needs the extra '{extra}': pip install 'hlp[{extra}]'"
        )
    if options:
        hint = nearest(names[-1].rpartition("/")[2], options) or "."
        return f"{said}{hint} There are {', '.join(options)}"
    if "override" not in said:
        return said
    key, known = names[-1], _all_keys()
    if key in known:
        return f"{said}: the chosen {key.partition('.')[0]} has no such key"
    hint = nearest(key, _keys_of_choices()) or nearest(key, known) or ":"
    return f"{said}{hint} `hlp run --cfg job` prints all keys"


def _keys_of_choices() -> list[str]:
    """All keys of the alternatives that the command line chooses, such as task=search."""
    try:
        return _all_keys(*filter(_CHOICE.fullmatch, sys.argv[1:]))
    except HydraException:  # one of them is wrong, too
        return []


def _all_keys(*overrides: str) -> list[str]:
    """All keys of a configuration (with no overrides: the default one), and its groups."""
    GlobalHydra.instance().clear()
    plain = OmegaConf.to_container(compose_config(*overrides), resolve=False)
    return list(_names(plain)) if isinstance(plain, dict) else []


def _names(nested: Mapping[Any, Any], prefix: str = "") -> Iterator[str]:
    for key, value in nested.items():
        yield f"{prefix}{key}"
        if isinstance(value, Mapping):
            yield from _names(value, f"{prefix}{key}.")
