"""No refinement: coarse poses stay as they are."""

from dataclasses import dataclass, field
from typing import Literal

from hlp.records import Hypotheses, ObjectModel, Refinement
from hlp.refinement.refiner import REFINERS, Refiner, checked_poses
from hlp.refinement.verification import Observation, VerificationSettings
from hlp.settings import Settings


@REFINERS.register
@dataclass(frozen=True)
class NoneSettings(Settings):
    """Config group `refinement`: coarse poses as they are, ranked as after refinement."""

    name: Literal["none"] = "none"
    verification: VerificationSettings = field(default_factory=VerificationSettings)

    def build(self, threads: int) -> "NoneRefiner":
        """The refiner; it has nothing to do."""
        return NoneRefiner()


class NoneRefiner(Refiner):
    """Leaves every pose where it is."""

    def refine(
        self,
        model: ObjectModel,
        observation: Observation,
        hypotheses: Hypotheses,
        seed: int,
        spent: float = 0.0,
    ) -> list[Refinement]:
        """See `Refiner.refine`. `seed` and `spent` are not used: nothing is random or timed."""
        return [Refinement(pose, 0) for pose in checked_poses(hypotheses, model)]
