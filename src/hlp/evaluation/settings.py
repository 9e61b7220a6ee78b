"""Settings of the evaluation: which poses are correct, and the bounds that explain misses."""

from dataclasses import dataclass


@dataclass(frozen=True)
class WaterfallSettings:
    """Bounds by which a miss gets its cause; keys as in conf/evaluation/waterfall/*.yaml."""

    basin_deg: float
    basin_mm: float
    vote_deg: float
    vote_mm: float
    good_votes: int
    region_share: float
    depth_share: float
    flip_fraction: float

    def __post_init__(self) -> None:
        """Raise ValueError naming the key of a share that is none."""
        for key in ("region_share", "depth_share"):
            if not 0 < getattr(self, key) <= 1:
                raise ValueError(
                    f"evaluation.waterfall.{key} is {getattr(self, key)}: a share, above 0 up to 1"
                )


@dataclass(frozen=True)
class EvaluationSettings:
    """A named policy; keys as in conf/evaluation/*.yaml.

    `symmetric` names the objects that are scored by ADD-S and, for the rotation error, by the
    nearest of the poses that look alike. A pose is correct by ADD(-S) below `add_fraction` of the
    diameter, by 5cm5deg below `translation_cm` and `rotation_deg`, by IoU from `iou` on. Intervals
    come from `bootstrap` resamplings. `waterfall` holds the bounds that explain misses.
    """

    name: str
    symmetric: list[str]
    add_fraction: float
    translation_cm: float
    rotation_deg: float
    iou: float
    bootstrap: int
    waterfall: WaterfallSettings

    def __post_init__(self) -> None:
        """Raise ValueError naming the key of a threshold that makes no sense."""
        for key in ("add_fraction", "translation_cm", "rotation_deg", "iou", "bootstrap"):
            if not getattr(self, key) > 0:
                raise ValueError(f"evaluation.{key} must be positive, not {getattr(self, key)}")
