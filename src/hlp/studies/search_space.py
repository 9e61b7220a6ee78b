"""The settings that a search may change, and their ranges."""

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import reduce
from pathlib import Path
from typing import TYPE_CHECKING, Any

from hlp.errors import ConfigError, DataError

if TYPE_CHECKING:
    from optuna.distributions import BaseDistribution

_KEY = "task.space.parameters"


@dataclass(frozen=True)
class Range:
    """Numbers from `low` to `high`, integers if both are; in steps, or on a logarithmic scale.

    Raises ValueError if the range is empty.
    """

    low: float
    high: float
    step: float | None = None
    log: bool = False

    def __post_init__(self) -> None:
        if not self.low < self.high:
            raise ValueError(f"low is {self.low} and high {self.high}")
        if self.log and (self.step is not None or self.low <= 0):
            raise ValueError("with log there is no step, and low must be above 0")

    def ends(self) -> tuple[Any, ...]:
        """The values to check: if the settings accept them, they accept all others."""
        return self.low, self.high

    def holds(self, value: Any) -> bool:
        """Whether a value lies in the range."""
        return isinstance(value, int | float) and self.low <= value <= self.high

    def distribution(self) -> "BaseDistribution":
        """The range as an Optuna distribution."""
        from optuna.distributions import FloatDistribution, IntDistribution

        if isinstance(self.low, int) and isinstance(self.high, int):
            return IntDistribution(self.low, self.high, self.log, int(self.step or 1))
        return FloatDistribution(self.low, self.high, self.log, self.step)


@dataclass(frozen=True)
class Choices:
    """Values to choose from. Raises ValueError if there are fewer than two."""

    choices: tuple[Any, ...]

    def __post_init__(self) -> None:
        if len(self.choices) < 2:
            raise ValueError("it takes at least two choices")

    def ends(self) -> tuple[Any, ...]:
        """The values to check: all of them."""
        return self.choices

    def holds(self, value: Any) -> bool:
        """Whether a value is one of the choices."""
        return value in self.choices

    def distribution(self) -> "BaseDistribution":
        """The choices as an Optuna distribution."""
        from optuna.distributions import CategoricalDistribution

        return CategoricalDistribution(self.choices)


Space = Mapping[str, Range | Choices]


def read_space(parameters: Mapping[str, Any], prefix: str = "") -> dict[str, Range | Choices]:
    """Ranges and choices by dotted key, of mappings nested as the whole configuration.

    Raises ConfigError naming a key that has neither `low` and `high` nor `choices`.
    """
    space: dict[str, Range | Choices] = {}
    for name, given in parameters.items():
        key = f"{prefix}{name}"
        if not isinstance(given, Mapping) or not given:
            raise ConfigError(f"{_KEY}.{key}: give it low and high, or choices")
        if any(isinstance(value, Mapping) for value in given.values()):
            space |= read_space(given, f"{key}.")
            continue
        try:
            one = {**given, "choices": tuple(given["choices"])} if "choices" in given else given
            space[key] = Choices(**one) if "choices" in given else Range(**one)
        except (TypeError, ValueError) as error:
            raise ConfigError(f"{_KEY}.{key} is {dict(given)}: {error}") from error
    return space


def check_within(space: Space, config: Mapping[str, Any]) -> dict[str, Any]:
    """The configuration's own values of a space's settings.

    Raises ConfigError naming a setting that is not in the configuration, or whose value there lies
    outside the space.
    """
    own = {}
    for key, each in space.items():
        try:
            own[key] = reduce(lambda node, part: node[part], key.split("."), config)
        except (KeyError, TypeError) as error:
            raise ConfigError(f"{_KEY}.{key}: the configuration has no {key}") from error
        if not each.holds(own[key]):
            raise ConfigError(f"{_KEY}.{key} leaves out the configuration's own value, {own[key]}")
    return own


def nested(values: Mapping[str, Any]) -> dict[str, Any]:
    """Values by dotted key as nested mappings: {"a.b": 1} → {"a": {"b": 1}}."""
    changes: dict[str, Any] = {}
    for key, value in values.items():
        *parents, last = key.split(".")
        node = changes
        for part in parents:
            node = node.setdefault(part, {})
        node[last] = value
    return changes


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
