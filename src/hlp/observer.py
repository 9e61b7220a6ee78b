"""Who is told which part of a search over a frame begins, for example to measure its time."""

from typing import Protocol


class Observer(Protocol):
    """Is told of each part as it begins; it lasts until the next one does."""

    def enter(self, part: str) -> None:
        """A part begins.

        One of windows, network, region (stage 1), cut, encode, search, vote, modes (stage 2),
        screen, refine, verify and second_search (stage 3).
        """


class NobodyWatches:
    """An observer that does nothing."""

    def enter(self, part: str) -> None:
        """See `Observer.enter`."""


NOBODY = NobodyWatches()
