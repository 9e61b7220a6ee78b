"""Frames that cannot be used: found before anything is computed, hardly decoding an image."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

from hlp.data.dataset import Dataset
from hlp.errors import HlpError
from hlp.records import ObjectModel


@dataclass(frozen=True)
class StatedTarget:
    """A target that a frame should have; its visible fraction is nan where it is not stated."""

    object_id: int
    visible_fraction: float = float("nan")


@runtime_checkable
class CheckedFrames(Protocol):
    """Frames read from files, which can be broken.

    A bad frame of such a source costs itself alone, because its targets are known without it.
    """

    def check(self, key: str, models: Mapping[int, ObjectModel]) -> None:
        """Raise an `HlpError` that names the file and says what is wrong with a frame.

        Only what its text files and the beginnings of its images tell is checked. `models` are the
        data set's objects by id.
        """
        ...

    def stated_targets(self, key: str) -> tuple[StatedTarget, ...]:
        """The targets of a frame, as many as would have to be found in it if it were sound."""
        ...


def find_bad_frames(dataset: Dataset, keys: Sequence[str]) -> dict[str, str]:
    """The frames that cannot be used, and why.

    Frames are decoded up to the first sound one, so that what is wrong with all of them, as a unit
    of depth, is said at once.
    """
    source = dataset.frames
    if not isinstance(source, CheckedFrames):
        return {}
    reasons: dict[str, str] = {}
    for key in keys:
        try:
            source.check(key, dataset.models)
        except HlpError as error:
            reasons[key] = str(error)
    for key in keys:
        if key in reasons:
            continue
        try:
            source.load(key)
            break
        except HlpError as error:
            reasons[key] = str(error)
    return reasons
