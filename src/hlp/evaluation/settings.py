"""Which poses count as correct."""

from dataclasses import dataclass


@dataclass(frozen=True)
class EvaluationSettings:
    """A named policy; keys as in conf/evaluation/*.yaml.

    `symmetric` names the objects that get ADI for ADD and, for the rotation error, the nearest of
    the poses that look alike. Thresholds: fraction of the diameter, cm, degrees, IoU. Intervals
    come from `bootstrap` resamplings.
    """

    name: str
    symmetric: list[str]
    ad_fraction: float
    translation_cm: float
    rotation_deg: float
    iou: float
    bootstrap: int

    def __post_init__(self) -> None:
        """Raise ValueError naming the key of a threshold that makes no sense."""
        for key in ("ad_fraction", "translation_cm", "rotation_deg", "iou", "bootstrap"):
            if not getattr(self, key) > 0:
                raise ValueError(f"evaluation.{key} must be positive, not {getattr(self, key)}")
