"""Names of stage outputs: a digest of all that decides what a stage writes."""

import dataclasses
import hashlib
import json
import math
from collections.abc import Mapping
from enum import Enum
from pathlib import Path
from typing import Any

import numpy as np


def fingerprint(
    stage: str, version: int, seed: int, settings: Any, upstream: Mapping[str, str]
) -> str:
    """Digest (16 hex digits) of everything that decides a stage's output.

    `version` is raised when the stage's code changes what it writes. `settings` is a settings
    dataclass or a mapping of them, without machine-specific keys (paths, threads, devices).
    `upstream` maps each input to the fingerprint of the stage that made it, or to the identity
    of the data it was read from. Raises TypeError and ValueError as `plain` does.
    """
    identity = {
        "stage": stage,
        "version": version,
        "seed": seed,
        "settings": plain(settings),
        "upstream": dict(upstream),
    }
    text = json.dumps(identity, sort_keys=True, separators=(",", ":"))
    return hashlib.blake2b(text.encode(), digest_size=8).hexdigest()


def plain(value: Any, key: str = "settings") -> Any:
    """Turn settings into what JSON can hold, the same for equal settings and for no others.

    A dataclass keeps its class's name, so that two alternatives with equal fields differ.
    Raises TypeError for what has no such form (arrays, sets, functions, keys that are no text)
    and ValueError for NaN, which equals nothing; both name the `key`.
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
        fields = {
            each.name: plain(getattr(value, each.name), f"{key}.{each.name}")
            for each in dataclasses.fields(value)
        }
        return {"class": type(value).__name__, "fields": fields}
    if isinstance(value, Mapping):
        return {_text_key(name, key): plain(item, f"{key}.{name}") for name, item in value.items()}
    if isinstance(value, list | tuple):
        return [plain(item, f"{key}[{index}]") for index, item in enumerate(value)]
    raise TypeError(f"{key} is a {type(value).__name__}: settings are plain values")


def _text_key(name: Any, key: str) -> str:
    if not isinstance(name, str):
        raise TypeError(f"{key} has the key {name!r}: keys of settings are text")
    return name
