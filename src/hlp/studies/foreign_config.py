"""Checks the configuration in a manifest, which may come from a stranger, before Hydra reads it.

It may choose settings. It may not name classes to be created, read the environment, change Hydra,
lead out of the output and work folders, or connect to a cluster, to which work is sent pickled.
"""

import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from hlp.errors import DataError

_NAME = re.compile(r"[\w][\w .+-]*")
_OF_HYDRA = ("hydra", "defaults")
_DEEPEST = 50


def check_harmless(config: Mapping[str, Any], manifest: Path, overrides: Sequence[str]) -> None:
    """Raise DataError, naming file and key, for a configuration that could do more than it should.

    The address of a cluster is accepted if it is among the overrides too, with any value.
    """

    def refuse(key: str, found: object, why: str) -> None:
        raise DataError(f"{manifest}: config.{key} is {str(found)[:100]!r}: {why}")

    for name in _OF_HYDRA:
        if name in config:
            refuse(name, config[name], "a manifest holds no configuration of Hydra")
    for key, value in _entries(config, manifest):
        last = key.rpartition(".")[2]
        if last.startswith("_"):
            refuse(key, value, "a manifest names nothing that is to be called")
        if "/" in last or "\\" in last:
            refuse(key, value, "no key is a path")
        if isinstance(value, str) and "${" in value:
            refuse(key, value, "a manifest holds plain values, which refer to nothing")
        if last == "name" and isinstance(value, str) and not _NAME.fullmatch(value):
            refuse(key, value, "a name is no path")
    executor = config.get("executor")
    address = executor.get("address") if isinstance(executor, Mapping) else None
    if address is not None and not any(each.startswith("executor.address=") for each in overrides):
        why = "work would be sent there; give executor.address=… yourself if it is your cluster"
        refuse("executor.address", address, why)


def _entries(config: Mapping[str, Any], manifest: Path) -> Iterator[tuple[str, Any]]:
    """All keys, joined by dots, and their values, those of lists too."""
    left: list[tuple[str, Any, int]] = [("", config, 0)]
    while left:
        key, value, depth = left.pop()
        if depth > _DEEPEST:
            raise DataError(f"{manifest}: config is nested more than {_DEEPEST} deep")
        if key:
            yield key, value
        items: Iterator[tuple[str, Any]] = iter(())
        if isinstance(value, Mapping):
            items = ((f"{key}.{name}" if key else str(name), item) for name, item in value.items())
        elif isinstance(value, list):
            items = ((f"{key}[{index}]", item) for index, item in enumerate(value))
        left += [(name, item, depth + 1) for name, item in items]
