"""Pose errors, verdicts on targets, recalls, causes of misses; here the settings of them all."""

from dataclasses import dataclass
from typing import Annotated

from annotated_types import Le

from hlp.records import ObjectModel
from hlp.settings import Count, Doc, Part, Positive, Settings


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
        Part, Doc("largest mean vertex distance, as a fraction of the diameter (P)")
    ] = 0.1
    translation_cm: Annotated[Positive, Doc("limit of 5cm5deg (P)")] = 5.0
    rotation_deg: Annotated[Positive, Doc("limit of 5cm5deg (P)")] = 5.0
    iou: Annotated[Part, Doc("smallest overlap of the projected boxes (P)")] = 0.5
    bootstrap: Annotated[Count, Le(100_000), Doc("resamplings for a 95 % interval (D)")] = 1000

    def is_symmetric(self, model: ObjectModel) -> bool:
        """Whether an object counts as symmetric."""
        if self.symmetric is None:
            return len(model.symmetries) > 1
        return model.name in self.symmetric
