"""No refinement: coarse poses stay as they are."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from hlp.records import Hypotheses, ObjectModel, Refinement
from hlp.refinement.refiner import Refiner, checked_poses
from hlp.refinement.verification import VerificationSettings


@dataclass(frozen=True)
class NoneSettings:
    """Nothing to set but what ranks the poses; see conf/refinement/none.yaml."""

    name: str
    verification: VerificationSettings


class NoneRefiner(Refiner):
    """Leaves every pose where it is."""

    def refine(
        self,
        model: ObjectModel,
        depth: Float[np.ndarray, "h w"],
        camera_matrix: Float[np.ndarray, "3 3"],
        hypotheses: Hypotheses,
        seed: int,
        spent: float = 0.0,
    ) -> list[Refinement]:
        """See `Refiner.refine`. `seed` and `spent` are not used: nothing is random or timed."""
        return [Refinement(pose, 0) for pose in checked_poses(hypotheses, model)]
