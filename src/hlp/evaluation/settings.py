"""Settings of the evaluation: which poses are correct, and the bounds that explain misses."""

from dataclasses import dataclass, field
from typing import Annotated

from annotated_types import Ge, Gt, Interval

from hlp.settings import Doc, Settings


@dataclass(frozen=True)
class WaterfallSettings(Settings):
    """What the failure waterfall and the votes' quality call near, enough and most (D)."""

    basin_deg: Annotated[
        float, Ge(0), Doc("a coarse pose this near to a right one is in the refiner's basin … (D)")
    ] = 30.0
    basin_mm: Annotated[float, Ge(0), Doc("… and its centroid this near (D)")] = 30.0
    vote_deg: Annotated[float, Ge(0), Doc("a vote this near to the truth is good … (D)")] = 15.0
    vote_mm: Annotated[float, Ge(0), Doc("… and its centroid this near (D)")] = 20.0
    good_votes: Annotated[int, Ge(1), Doc("fewer are too few for a hypothesis (D)")] = 5
    region_share: Annotated[
        float,
        Interval(gt=0, le=1),
        Doc("a region must cover this share of what is visible of the object (D)"),
    ] = 0.25
    depth_share: Annotated[
        float, Interval(gt=0, le=1), Doc("of what is visible, this share must have depth (D)")
    ] = 0.5
    flip_fraction: Annotated[
        float,
        Ge(0),
        Doc(
            "a pose turned by more than the basin, but with ADD-S below this part of the diameter, "
            "is right but for a (near) symmetry (D)"
        ),
    ] = 0.1


@dataclass(frozen=True)
class EvaluationSettings(Settings):
    """Config group `evaluation`: which poses count as correct."""

    name: Annotated[str, Doc("of the policy")] = "bop"
    symmetric: Annotated[
        tuple[str, ...],
        Doc(
            "names of objects that are scored by ADD-S and, for the rotation error, by the "
            "nearest of the poses that look alike (D)"
        ),
    ] = ("bowl", "cup", "eggbox", "glue")
    add_fraction: Annotated[
        float, Gt(0), Doc("mean vertex distance below this part of the diameter (P)")
    ] = 0.1
    translation_cm: Annotated[float, Gt(0), Doc("5cm5deg (P)")] = 5.0
    rotation_deg: Annotated[float, Gt(0), Doc("5cm5deg (P)")] = 5.0
    iou: Annotated[float, Gt(0), Doc("overlap of the projected boxes, at least (P)")] = 0.5
    bootstrap: Annotated[
        int, Ge(1), Doc("resamplings of the frames behind a 95 % interval (D)")
    ] = 1000
    waterfall: WaterfallSettings = field(default_factory=WaterfallSettings)
