"""Errors of the configuration, in overrides or YAML files, in one sentence that says what to do."""

import re
import sys
from collections.abc import Iterator, Mapping
from typing import Any

from omegaconf.errors import OmegaConfBaseException
from yaml import MarkedYAMLError

from hlp.commands import composing
from hlp.commands.nearest import nearest

_NO_KEY = re.compile(r"Could not override '([^']+)'")
_NO_FILE = re.compile(r"Could not find '([^']+)'")
_CHOICE = re.compile(r"[\w/]+=[\w.-]+")
_NO_DEFAULT = re.compile(r"In '([^']+)': Could not load '([^']+)'")
_WITHIN = re.compile(r"^In '(?!config')([^']+)': ")
_SEVERAL = re.compile(r"Ambiguous value for argument '([^'=]+)=(.+)'")
_OPTIONS = re.compile(r"Available options in '[^']+':\n((?:\t.+\n)+)")
# Launchers that come with a plugin of Hydra's, and the extra that installs it.
_LAUNCHERS = "hydra/launcher"
_EXTRAS = {"joblib": "joblib", "submitit_slurm": "slurm", "submitit_local": "slurm"}


def hydra_in_words(error: BaseException) -> str:
    """An error of Hydra's as one sentence; its own message if it is of an unknown kind."""
    text = str(error)
    if isinstance(error, MarkedYAMLError):
        return _no_yaml(error)
    if found := _SEVERAL.search(text):
        key, values = found.groups()
        return (
            f"{key}={values} is several values: add -m for a sweep, or {key}=[{values}] as a list"
        )
    override = getattr(error, "override", None)
    if override is not None:
        return _unreadable(str(override), text)
    if found := _NO_KEY.search(text):
        key, known = found[1], all_keys()
        if key in known:
            group = key.partition(".")[0]
            return (
                f"{key} is no key of the chosen {group}: `hlp run {group}=… --cfg job` prints them"
            )
        within = _WITHIN.search(text)
        file = f"{within[1]}.yaml: " if within else ""
        hint = nearest(key, _keys_of_choices()) or nearest(key, known) or ";"
        return f"{file}{key} is no key{hint} `hlp run --cfg job` prints all keys"
    if found := _NO_DEFAULT.search(text):
        return _no_default(*found.groups())
    if found := _NO_FILE.search(text):
        return _no_alternative(found[1], text)
    if isinstance(error, OmegaConfBaseException):
        where = f"{error.full_key}: " if error.full_key else ""
        return f"{where}{text.splitlines()[0] if text else type(error).__name__}"
    return text


def _unreadable(override: str, text: str) -> str:
    if "=" not in override:
        return f"cannot use '{override}': settings are given as KEY=VALUE, e.g. seed=1"
    lines = [each for each in text.splitlines() if not each.startswith(("Error parsing", "See "))]
    why = f" ({lines[0]})" if lines else ""
    key, _, value = override.partition("=")
    return (
        f"cannot read '{override}'{why}: close all brackets and quotes; a value with signs such as"
        f" []{{}}(), or spaces is quoted twice: '{key}=\"{value}\"'"
    )


def _no_yaml(error: MarkedYAMLError) -> str:
    mark = error.problem_mark or error.context_mark
    place = f"{mark.name}, line {mark.line + 1}" if mark is not None else "a configuration"
    return f"{place} is not YAML: {error.problem or error.context}"


def _no_default(file: str, named: str) -> str:
    group, _, name = named.rpartition("/")
    if group == _LAUNCHERS and name in _EXTRAS:
        chosen_group, _, chosen = file.rpartition("/")
        return _no_launcher(chosen if chosen_group == _LAUNCHERS else name, _EXTRAS[name])
    folder = composing.config_folder() / group
    known = sorted(f"{group}/{path.stem}".lstrip("/") for path in folder.glob("*.yaml"))
    return f"{file}.yaml: its defaults name {named}, which is no file{nearest(named, known)}"


def _no_alternative(named: str, text: str) -> str:
    group, _, name = named.rpartition("/")
    if group == _LAUNCHERS and name in _EXTRAS:
        return _no_launcher(name, _EXTRAS[name])
    options = _OPTIONS.search(text)
    known = options[1].split() if options else []
    listed = f" There are {', '.join(known)}" if known else ""
    return f"{group}={name} is no alternative{nearest(name, known) or '.'}{listed}"


def _no_launcher(name: str, extra: str) -> str:
    return f"{_LAUNCHERS}={name} needs the extra '{extra}': pip install 'hlp[{extra}]'"


def _keys_of_choices() -> list[str]:
    """All keys of the alternatives that the command line chooses, such as task=search."""
    from hydra.errors import HydraException

    try:
        return all_keys(*filter(_CHOICE.fullmatch, sys.argv[1:]))
    except HydraException:  # one of them is wrong, too
        return []


def all_keys(*overrides: str) -> list[str]:
    """All keys of a configuration (with no overrides: the default one), and its groups."""
    from hydra.core.global_hydra import GlobalHydra
    from omegaconf import OmegaConf

    GlobalHydra.instance().clear()
    plain = OmegaConf.to_container(composing.compose_config(*overrides), resolve=False)
    return list(_names(plain)) if isinstance(plain, dict) else []


def _names(nested: Mapping[Any, Any], prefix: str = "") -> Iterator[str]:
    for key, value in nested.items():
        yield f"{prefix}{key}"
        if isinstance(value, Mapping):
            yield from _names(value, f"{prefix}{key}.")
