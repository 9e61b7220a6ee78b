"""One reproducible run: score, draw, log."""

from collections.abc import Sequence
from typing import TypeVar

_Item = TypeVar("_Item")


def spread(items: Sequence[_Item], most: int) -> list[_Item]:
    """`most` of the items, or all, spread evenly."""
    count = min(most, len(items))
    return [items[i * len(items) // count] for i in range(count)]
