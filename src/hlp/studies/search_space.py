"""The settings that a search may change, and their ranges."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import reduce
from typing import TYPE_CHECKING, Any

from hlp.errors import ConfigError

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
