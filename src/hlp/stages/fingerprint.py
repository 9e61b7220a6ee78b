"""Fingerprints: names of stage outputs, made from everything that affects their content."""

import dataclasses
import hashlib
import json
import math
import re
from collections.abc import Mapping
from enum import Enum
from pathlib import Path
from typing import Any

import numpy as np

from hlp.source_code import Code, code_of

# They collect the settings of the whole method. Their values are in each fingerprint already, and
# the code that a stage runs is imported by the stage itself.
_COLLECTS = ("hlp.method.settings", "hlp.method.stage_settings")
_FINGERPRINT = re.compile(r"[0-9a-f]{16}")


def stage_code(*modules: str) -> Code:
    """The code that these modules run, without the code of other stages."""
    return code_of(*sorted(set(modules)), leaving_out=_COLLECTS)


def fingerprint(
    stage: str, code: Code, seed: int, settings: Any, upstream: Mapping[str, str]
) -> str:
    """Digest (16 hex digits) of everything that affects a stage's output.

    `code` is the source and the libraries that the stage uses. `settings` is a settings dataclass
    or a mapping of them, without those that change only the time (paths, threads). `upstream` maps
    each input to the fingerprint of the stage that made it, or to the identity of the data it was
    read from. Raises TypeError and ValueError as `plain` does.
    """
    identity = {
        "stage": stage,
        "source": code.source,
        "libraries": code.libraries,
        "seed": seed,
        "settings": plain(settings),
        "upstream": dict(upstream),
    }
    text = json.dumps(identity, sort_keys=True, separators=(",", ":"))
    return hashlib.blake2b(text.encode(), digest_size=8).hexdigest()


def is_fingerprint(text: str) -> bool:
    """Whether a text has the form of a fingerprint, and so is the name of a folder, not a path."""
    return _FINGERPRINT.fullmatch(text) is not None


def plain(value: Any, key: str = "settings") -> Any:
    """Settings as JSON values: the same for equal settings, different for different ones.

    A dataclass keeps the name of its class, so that two alternatives with equal fields differ.
    Raises TypeError for values that JSON lacks (arrays, sets, functions, keys that are not strings)
    and ValueError for NaN, which never equals itself. Both name the `key`.
    """
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, Enum):
        return plain(value.value, key)
    if value is None or isinstance(value, bool | int | str):
        return value
    if isinstance(value, float):
        if math.isnan(value):
            raise ValueError(f"{key} is NaN: settings must be comparable")
        return value
    if isinstance(value, Path):
        return value.as_posix()
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        fields = {field.name: getattr(value, field.name) for field in dataclasses.fields(value)}
        return {"class": type(value).__name__, "fields": plain(fields, key)}
    if isinstance(value, Mapping):
        for name in value:
            if not isinstance(name, str):
                raise TypeError(f"{key} has the key {name!r}: keys of settings are text")
        return {name: plain(item, f"{key}.{name}") for name, item in value.items()}
    if isinstance(value, list | tuple):
        return [plain(item, f"{key}[{index}]") for index, item in enumerate(value)]
    raise TypeError(f"{key} is a {type(value).__name__}: settings are plain values")
