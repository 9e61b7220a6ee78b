"""Failure waterfall: one cause for every target that was missed (wrong by AD), and their counts.

A stage that did its part clears those before it, so the search begins at the end. The first line
that is true names the cause:

symmetric_flip    the answer is right but for a turn that (nearly) maps the object onto itself
ranking           a right refined pose was there, another one was chosen
refiner_diverged  a coarse pose within the basin was refined, and no refined pose is right
screening         a coarse pose was within the basin, but not among those chosen for refinement
depth_missing     most of what is visible of the object has no depth
no_window         no window's centre lies on what is visible of the object
wrong_region      the region is empty or covers too little of what is visible of the object
few_votes         too few votes are near the truth to make a hypothesis
outside_basin     votes enough, and yet no coarse pose is within the basin of a right pose
"""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Bool, Int

from hlp.evaluation.settings import WaterfallSettings
from hlp.records import TargetScore

CORRECT = "correct"
CAUSES = (
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
"""Why targets are missed, from the first stage to the last."""

VISIBILITY = {"0-0.1": 0.1, "0.1-0.3": 0.3, "0.3-0.6": 0.6, "0.6-1": np.inf}
"""Classes of the visible fraction and the bound that each stays below."""
UNSTATED = "not stated"


@dataclass(frozen=True)
class Evidence:
    """What the stages left of one target.

    `visible`, `with_depth` and `in_region` count pixels on which the object is visible, `windows`
    the centres of windows there. `near_basin` of every coarse pose, `refined` the indices of those
    that were refined, `right` of what became of each.
    """

    visible: int
    with_depth: int
    windows: int
    in_region: int
    good_votes: int
    near_basin: Bool[np.ndarray, "m"]
    refined: Int[np.ndarray, "c"]
    right: Bool[np.ndarray, "c"]
    flipped: bool


def cause_of(evidence: Evidence, settings: WaterfallSettings) -> str:
    """The one cause of a miss; see above for the order of decision."""
    decided = (
        ("symmetric_flip", evidence.flipped),
        ("ranking", bool(evidence.right.any())),
        ("refiner_diverged", bool(evidence.near_basin[evidence.refined].any())),
        ("screening", bool(evidence.near_basin.any())),
        ("depth_missing", evidence.with_depth < settings.depth_share * evidence.visible),
        ("no_window", evidence.windows == 0),
        ("wrong_region", evidence.in_region < settings.region_share * evidence.visible),
        ("few_votes", evidence.good_votes < settings.good_votes),
    )
    return next((cause for cause, true in decided if true), "outside_basin")


def count_causes(scores: Sequence[TargetScore], names: Mapping[int, str]) -> dict[str, Any]:
    """How many targets are correct and how many were lost by which cause.

    In all (`total`), for each object (`per_object`) and for each class of the visible fraction
    (`per_visibility`; no class that holds no target). Raises ValueError naming a miss that has no
    cause.
    """
    for score in scores:
        if not score.add_correct and score.cause not in CAUSES:
            raise ValueError(
                f"scene {score.scene_id}, frame {score.frame_id}, object {score.object_id} was"
                f" missed, but its cause is '{score.cause}'"
            )
    objects: dict[str, list[TargetScore]] = {}
    for score in sorted(scores, key=lambda each: each.object_id):
        objects.setdefault(names[score.object_id], []).append(score)
    classes: dict[str, list[TargetScore]] = {name: [] for name in (*VISIBILITY, UNSTATED)}
    for score in scores:
        classes[visibility_class(score.visible_fraction)].append(score)
    return {
        "total": _count(scores),
        "per_object": {name: _count(group) for name, group in objects.items()},
        "per_visibility": {name: _count(group) for name, group in classes.items() if group},
    }


def visibility_class(fraction: float) -> str:
    """The class of a visible fraction, a bound belonging to the class above it."""
    return next((name for name, bound in VISIBILITY.items() if fraction < bound), UNSTATED)


def _count(scores: Sequence[TargetScore]) -> dict[str, int]:
    counts = Counter(CORRECT if score.add_correct else score.cause for score in scores)
    return {name: counts[name] for name in (CORRECT, *CAUSES)}
