"""Pose errors, verdicts on targets, recalls, causes of misses; here the settings of them all."""

from dataclasses import dataclass, field
from typing import Annotated

from annotated_types import Interval, Le

from hlp.records import ObjectModel
from hlp.settings import Count, Doc, NotNegative, Positive, Settings, Share

_Part = Annotated[float, Interval(gt=0, le=1)]


@dataclass(frozen=True)
class WaterfallSettings(Settings):
    """What the failure waterfall and the votes' quality call near, enough and most (D)."""

    basin_deg: Annotated[
        NotNegative,
        Doc("a coarse pose is in the refiner's basin if its rotation is within this … (D)"),
    ] = 30.0
    basin_mm: Annotated[NotNegative, Doc("… and its centroid within this of the truth (D)")] = 30.0
    vote_deg: Annotated[NotNegative, Doc("a vote is good if its rotation is within this … (D)")] = (
        15.0
    )
    vote_mm: Annotated[NotNegative, Doc("… and its centroid within this of the truth (D)")] = 20.0
    good_votes: Annotated[Count, Doc("fewer good votes are too few for a hypothesis (D)")] = 5
    region_share: Annotated[
        _Part, Doc("fraction of the visible part of the object that a region must cover (D)")
    ] = 0.25
    depth_share: Annotated[_Part, Doc("fraction of the visible part that must have depth (D)")] = (
        0.5
    )
    flip_fraction: Annotated[
        Share,
        Doc(
            "a pose outside the basin with ADD-S below this fraction of the diameter is right "
            "except for a (near) symmetry (D)"
        ),
    ] = 0.1


@dataclass(frozen=True)
class EvaluationSettings(Settings):
    """Config group `evaluation`: which poses count as correct."""

    name: Annotated[str, Doc("name of the policy")] = "symmetries"
    symmetric: Annotated[
        tuple[str, ...] | None,
        Doc(
            "names of objects that are scored by ADD-S and whose rotation error is that of the "
            "nearest equivalent pose; null: objects whose models have symmetries (D)"
        ),
    ] = None
    add_fraction: Annotated[
        _Part, Doc("largest mean vertex distance, as a fraction of the diameter (P)")
    ] = 0.1
    translation_cm: Annotated[Positive, Doc("limit of 5cm5deg (P)")] = 5.0
    rotation_deg: Annotated[Positive, Doc("limit of 5cm5deg (P)")] = 5.0
    iou: Annotated[_Part, Doc("smallest overlap of the projected boxes (P)")] = 0.5
    bootstrap: Annotated[Count, Le(100_000), Doc("resamplings for a 95 % interval (D)")] = 1000
    waterfall: WaterfallSettings = field(default_factory=WaterfallSettings)

    def is_symmetric(self, model: ObjectModel) -> bool:
        """Whether an object counts as symmetric."""
        if self.symmetric is None:
            return len(model.symmetries) > 1
        return model.name in self.symmetric
