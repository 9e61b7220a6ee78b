"""How many votes are good, that is near the true pose, and who cast the others."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Bool, Float


@dataclass(frozen=True)
class VoteCounts:
    """Numbers of votes for one object in one frame: all, good ones, and the weight of both.

    `cast_by_object` counts the votes of patches that lie on the visible object, `good_by_object`
    the good ones among these.
    """

    object_id: int
    votes: int
    good: int
    weight: float
    good_weight: float
    cast_by_object: int
    good_by_object: int

    @classmethod
    def of(
        cls,
        object_id: int,
        good: Bool[np.ndarray, "v"],
        weights: Float[np.ndarray, "v"],
        on_object: Bool[np.ndarray, "v"],
    ) -> "VoteCounts":
        """Count votes, given which are good and which were cast by patches on the object."""
        return cls(
            object_id,
            len(good),
            int(good.sum()),
            float(weights.sum()),
            float(weights[good].sum()),
            int(on_object.sum()),
            int((good & on_object).sum()),
        )


def vote_quality(counts: Iterable[VoteCounts], names: Mapping[int, str]) -> dict[str, Any]:
    """Shares of good votes over all objects (`total`) and per object; None where nobody voted.

    `good` is the share of the votes and `good_weight` of their weight. `by_object` is the share
    that patches on the object cast (a low one is the region's fault), `good_by_object` the share of
    good votes among those (a low one is the features' fault). `votes` is the mean number of votes
    for one object in one frame.
    """
    groups: dict[str, list[VoteCounts]] = {}
    for each in sorted(counts, key=lambda item: item.object_id):
        groups.setdefault(names[each.object_id], []).append(each)
    everything = [each for group in groups.values() for each in group]
    per_object = {name: _quality(group) for name, group in groups.items()}
    return {"total": _quality(everything), "per_object": per_object}


def _quality(counts: list[VoteCounts]) -> dict[str, float | None]:
    votes = sum(each.votes for each in counts)
    weight = sum(each.weight for each in counts)
    cast = sum(each.cast_by_object for each in counts)
    return {
        "good": _ratio(sum(each.good for each in counts), votes),
        "good_weight": _ratio(sum(each.good_weight for each in counts), weight),
        "by_object": _ratio(cast, votes),
        "good_by_object": _ratio(sum(each.good_by_object for each in counts), cast),
        "votes": _ratio(votes, len(counts)),
    }


def _ratio(part: float, whole: float) -> float | None:
    return part / whole if whole else None
