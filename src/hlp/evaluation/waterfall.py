"""Failure waterfall: one cause for every missed target (wrong by ADD(-S)), and counts of causes.

If a late stage had what it needed, the stages before it did their part. So the causes are checked
from the last stage to the first, and the first one that applies is the cause. A target of a frame
that cannot be used has the first of them:

bad_frame         the frame's files are broken or missing
symmetric_flip    the pose is right except for a turn that nearly maps the object onto itself
ranking           one of the refined poses is right, but another one was chosen
refiner_diverged  a coarse pose within the basin was refined, but no refined pose is right
screening         a coarse pose is within the basin, but was not chosen for refinement
depth_missing     most of the visible part of the object has no depth
no_window         no window centre lies on the visible part of the object
wrong_region      the region is empty or covers too little of the visible part of the object
few_votes         too few votes are near the truth to form a hypothesis
outside_basin     there are enough good votes, but no coarse pose is within the basin
"""

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float

from hlp.arrays import Flags, Rows, grouped
from hlp.records import TargetScore
from hlp.results.recalls import CORRECT

BAD_FRAME = "bad_frame"
CAUSES = (
    BAD_FRAME,
    "depth_missing",
    "no_window",
    "wrong_region",
    "few_votes",
    "outside_basin",
    "screening",
    "refiner_diverged",
    "ranking",
    "symmetric_flip",
)
"""The causes, from the files and the first stage to the last."""

VISIBILITY = {"0-0.1": 0.1, "0.1-0.3": 0.3, "0.3-0.6": 0.6, "0.6-1": np.inf}
"""Classes of the visible fraction, and the upper bound of each (exclusive)."""
UNSTATED = "not stated"
_WITH_DEPTH, _IN_REGION = 0.5, 0.25  # of the visible part, at least (D)
_GOOD_VOTES = 5  # that make a hypothesis, at least (D)


@dataclass(frozen=True)
class TargetCounts:
    """What the first two stages made of one target, counted while its frame is decoded.

    `visible` is the number of pixels that show the object; `with_depth` and `in_region` count those
    of them that have depth or lie in the region, `windows` the window centres among them.
    """

    visible: int
    with_depth: int
    windows: int
    in_region: int
    good_votes: int


def cause_of(
    counts: TargetCounts, *, near_basin: Flags, refined: Rows, right: Flags, flipped: bool
) -> str:
    """The cause of a miss; the module's docstring lists the causes in the order of the checks.

    `near_basin` says of every coarse pose whether it is within the refiner's basin, `refined` are
    the indices of the refined ones, and `right` says of each refined pose whether it is right.
    `flipped`: the chosen pose is right except for a turn that nearly maps the object onto itself.
    """
    checks = (
        ("symmetric_flip", flipped),
        ("ranking", bool(right.any())),
        ("refiner_diverged", bool(near_basin[refined].any())),
        ("screening", bool(near_basin.any())),
        ("depth_missing", counts.with_depth < _WITH_DEPTH * counts.visible),
        ("no_window", counts.windows == 0),
        ("wrong_region", counts.in_region < _IN_REGION * counts.visible),
        ("few_votes", counts.good_votes < _GOOD_VOTES),
    )
    return next((cause for cause, applies in checks if applies), "outside_basin")


def count_causes(scores: Sequence[TargetScore], names: Mapping[int, str]) -> dict[str, Any]:
    """Number of correct targets and of misses by cause.

    Counted over all targets (`total`), per object (`per_object`) and per class of the visible
    fraction (`per_visibility`, without classes that hold no target).
    """
    objects = by_object(scores, names)
    classes = grouped(scores, lambda score: visibility_class(score.visible_fraction))
    shown = [name for name in (*VISIBILITY, UNSTATED) if name in classes]
    return {
        "total": _count(scores),
        "per_object": {name: _count(group) for name, group in objects.items()},
        "per_visibility": {name: _count(classes[name]) for name in shown},
    }


def by_object(records: Iterable[Any], names: Mapping[int, str]) -> dict[str, list[Any]]:
    """Records by the name of their object, the objects in the order of their ids."""
    ordered = sorted(records, key=lambda record: record.object_id)
    return grouped(ordered, lambda record: names[record.object_id])


def visibility_class(fraction: float) -> str:
    """The class of a visible fraction; a bound belongs to the class above it."""
    return next((name for name, bound in VISIBILITY.items() if fraction < bound), UNSTATED)


def _count(scores: Sequence[TargetScore]) -> dict[str, int]:
    counts = Counter(CORRECT if score.add_correct else score.cause for score in scores)
    return {name: counts[name] for name in (CORRECT, *CAUSES)}


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
        cls, object_id: int, good: Flags, weights: Float[np.ndarray, "v"], on_object: Flags
    ) -> "VoteCounts":
        """Count votes, given which are good and which were cast by patches on the object."""
        counts = len(good), int(good.sum())
        weight = float(weights.sum()), float(weights[good].sum())
        return cls(object_id, *counts, *weight, int(on_object.sum()), int((good & on_object).sum()))


def vote_quality(counts: Iterable[VoteCounts], names: Mapping[int, str]) -> dict[str, Any]:
    """Shares of good votes over all objects (`total`) and per object; None where nobody voted.

    `good` is the share of the votes and `good_weight` of their weight. `by_object` is the share
    that patches on the object cast (a low one is the region's fault), `good_by_object` the share of
    good votes among those (a low one is the features' fault). `votes` is the mean number of votes
    for one object in one frame.
    """
    groups = by_object(counts, names)
    total = _quality([count for group in groups.values() for count in group])
    return {"total": total, "per_object": {name: _quality(own) for name, own in groups.items()}}


def _quality(counts: list[VoteCounts]) -> dict[str, float | None]:
    def ratio(part: str, whole: str) -> float | None:
        parts, wholes = (sum(getattr(own, name) for own in counts) for name in (part, whole))
        return parts / wholes if wholes else None

    return {
        "good": ratio("good", "votes"),
        "good_weight": ratio("good_weight", "weight"),
        "by_object": ratio("cast_by_object", "votes"),
        "good_by_object": ratio("good_by_object", "cast_by_object"),
        "votes": sum(own.votes for own in counts) / len(counts) if counts else None,
    }
