"""Errors of the configuration, in overrides or YAML files, in one sentence that says what to do.

Hydra says most of what is wrong in prose alone. This module reads that of Hydra 1.3 (see
pyproject.toml); a message that is worded otherwise is shown as it is.
"""

import re
import sys
from collections.abc import Callable, Iterator, Mapping
from typing import Any

from hydra.core.global_hydra import GlobalHydra
from hydra.errors import HydraException
from omegaconf import OmegaConf
from omegaconf.errors import OmegaConfBaseException
from yaml import MarkedYAMLError

from hlp.commands.arguments import nearest
from hlp.commands.composing import compose_config
from hlp.config.typed_defaults import rows
from hlp.files import config_folder

_CHOICE = re.compile(r"[\w/]+=[\w.-]+")
_WITHIN = re.compile(r"^In '(?!config')([^']+)': ")
_OPTIONS = re.compile(r"Available options in '[^']+':\n((?:\t.+\n)+)")
# Launchers that come with a plugin of Hydra's, and the extra that installs it.
_LAUNCHERS = "hydra/launcher/"
_EXTRAS = {
    "hydra/launcher/joblib": "joblib",
    "hydra/launcher/submitit_slurm": "slurm",
    "hydra/launcher/submitit_local": "slurm",
}


def hydra_in_words(error: BaseException) -> str:
    """An error of Hydra's as one sentence; its own message if it is of an unknown kind."""
    text = str(error)
    if isinstance(error, MarkedYAMLError):
        return _no_yaml(error)
    if (override := getattr(error, "override", None)) is not None:
        return _unreadable(str(override), text)
    for pattern, in_words in _KINDS.items():
        if found := re.search(pattern, text):
            return in_words(text, *found.groups())
    if isinstance(error, OmegaConfBaseException):
        where = f"{error.full_key}: " if error.full_key else ""
        first = text.partition("\n")[0]
        return f"{where}{first or type(error).__name__}"
    return text


def _no_yaml(error: MarkedYAMLError) -> str:
    mark = error.problem_mark or error.context_mark
    place = f"{mark.name}, line {mark.line + 1}" if mark is not None else "a configuration"
    return f"{place} is not YAML: {error.problem or error.context}"


def _unreadable(override: str, text: str) -> str:
    if "=" not in override:
        return f"cannot use '{override}': settings are given as KEY=VALUE, e.g. seed=1"
    lines = [line for line in text.splitlines() if not line.startswith(("Error parsing", "See "))]
    why = f" ({lines[0]})" if lines else ""
    key, _, value = override.partition("=")
    return (
        f"cannot read '{override}'{why}: close all brackets and quotes; a value with signs such as"
        f" []{{}}(), or spaces is quoted twice: '{key}=\"{value}\"'"
    )


def _several(text: str, key: str, values: str) -> str:
    return f"{key}={values} is several values: add -m for a sweep, or {key}=[{values}] as a list"


def _no_key(text: str, key: str) -> str:
    known = _all_keys()
    if key in known:
        group = key.partition(".")[0]
        return f"{key} is no key of the chosen {group}: `hlp run {group}=… --cfg job` prints them"
    within = _WITHIN.search(text)
    file = f"{within[1]}.yaml: " if within else ""
    hint = nearest(key, _keys_of_choices()) or nearest(key, known) or ";"
    return f"{file}{key} is no key{hint} `hlp run --cfg job` prints all keys"


def _no_default(text: str, file: str, named: str) -> str:
    group, _, _ = named.rpartition("/")
    if named in _EXTRAS:
        return _no_launcher(file if file.startswith(_LAUNCHERS) else named, _EXTRAS[named])
    names = {path.stem for path in (config_folder() / group).glob("*.yaml")}
    known = [f"{group}/{name}".lstrip("/") for name in sorted(names | {*rows().get(group, {})})]
    return f"{file}.yaml: its defaults name {named}, which is no file{nearest(named, known)}"


def _no_alternative(text: str, named: str) -> str:
    group, _, name = named.rpartition("/")
    if named in _EXTRAS:
        return _no_launcher(named, _EXTRAS[named])
    options = _OPTIONS.search(text)
    known = options[1].split() if options else []
    listed = f" There are {', '.join(known)}" if known else ""
    return f"{group}={name} is no alternative{nearest(name, known) or '.'}{listed}"


def _no_launcher(named: str, extra: str) -> str:
    return f"{'='.join(named.rsplit('/', 1))} needs the extra '{extra}': pip install 'hlp[{extra}]'"


_KINDS: dict[str, Callable[..., str]] = {
    r"Ambiguous value for argument '([^'=]+)=(.+)'": _several,
    r"Could not override '([^']+)'": _no_key,
    r"In '([^']+)': Could not load '([^']+)'": _no_default,
    r"Could not find '([^']+)'": _no_alternative,
}
"""What a message of each kind holds, and what makes a sentence of it and of its groups."""


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
