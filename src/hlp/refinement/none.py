"""No refinement: coarse poses as they are, with the cost that ranks them."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from hlp.records import Hypotheses, ObjectModel, Refinement
from hlp.refinement.cost import CostSettings, verify
from hlp.refinement.refiner import checked_poses


@dataclass(frozen=True)
class NoneSettings:
    """Settings of the cost; see conf/refinement/none.yaml."""

    name: str
    cost: CostSettings


class NoneRefiner:
    """Leaves every pose where it is."""

    def __init__(self, settings: NoneSettings) -> None:
        self._settings = settings

    def refine(
        self,
        model: ObjectModel,
        depth: Float[np.ndarray, "h w"],
        camera_matrix: Float[np.ndarray, "3 3"],
        hypotheses: Hypotheses,
        seed: int,
    ) -> list[Refinement]:
        """See Refiner.refine. Nothing is drawn at random: `seed` is not used."""
        return [
            Refinement(
                pose, verify(model.proxy, depth, camera_matrix, pose, self._settings.cost), 0
            )
            for pose in checked_poses(hypotheses)
        ]
