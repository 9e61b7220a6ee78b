"""Hydra's errors of the command line in one sentence that says what to do instead."""

import re
from collections.abc import Iterator, Mapping
from typing import Any

from hlp.commands import composing
from hlp.commands.nearest import nearest

_NO_KEY = re.compile(r"Could not override '([^']+)'")
_NO_FILE = re.compile(r"Could not find '([^']+)'")
_SEVERAL = re.compile(r"Ambiguous value for argument '([^'=]+)=(.+)'")
_OPTIONS = re.compile(r"Available options in '[^']+':\n((?:\t.+\n)+)")


def hydra_in_words(error: BaseException) -> str:
    """An error of Hydra's as one sentence; its own message if it is of an unknown kind."""
    text = str(error)
    if found := _SEVERAL.search(text):
        key, values = found.groups()
        return (
            f"{key}={values} is several values: add -m for a sweep, or {key}=[{values}] as a list"
        )
    override = getattr(error, "override", None)
    if override is not None:
        return _unreadable(str(override), text)
    if found := _NO_KEY.search(text):
        key, known = found[1], _keys()
        if key in known:
            group = key.partition(".")[0]
            return (
                f"{key} is no key of the chosen {group}: `hlp run {group}=… --cfg job` prints them"
            )
        return f"{key} is no key{nearest(key, known) or ';'} `hlp run --cfg job` prints all keys"
    if found := _NO_FILE.search(text):
        return _no_alternative(found[1], text)
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


def _no_alternative(named: str, text: str) -> str:
    group, _, name = named.rpartition("/")
    options = _OPTIONS.search(text)
    known = options[1].split() if options else []
    listed = f" There are {', '.join(known)}" if known else ""
    return f"{group}={name} is no alternative{nearest(name, known) or '.'}{listed}"


def _keys() -> list[str]:
    """All keys of the default configuration, and its groups."""
    from hydra.core.global_hydra import GlobalHydra
    from omegaconf import OmegaConf

    GlobalHydra.instance().clear()
    plain = OmegaConf.to_container(composing.compose_config(), resolve=False)
    return list(_names(plain)) if isinstance(plain, dict) else []


def _names(nested: Mapping[Any, Any], prefix: str = "") -> Iterator[str]:
    for key, value in nested.items():
        yield f"{prefix}{key}"
        if isinstance(value, Mapping):
            yield from _names(value, f"{prefix}{key}.")
