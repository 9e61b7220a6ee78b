"""What somebody who mistyped a word has probably meant."""

from collections.abc import Iterable
from difflib import get_close_matches

_NEAR = 0.6  # two letters exchanged in a word of three


def nearest(word: str, known: Iterable[str]) -> str:
    """`: did you mean …?` if one of the known words is near, else nothing."""
    close = get_close_matches(word, [*known], 1, _NEAR)
    return f": did you mean {close[0]}?" if close else ""
