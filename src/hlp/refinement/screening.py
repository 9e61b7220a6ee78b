"""Which coarse poses are worth refining: those whose rendering already agrees with the depth."""

import numpy as np
from jaxtyping import Float, Int

from hlp.records import Hypotheses, ObjectModel
from hlp.refinement.cost import CostSettings, verify
from hlp.refinement.refiner import checked_poses


def screen(
    model: ObjectModel,
    depth: Float[np.ndarray, "h w"],
    camera_matrix: Float[np.ndarray, "3 3"],
    hypotheses: Hypotheses,
    settings: CostSettings,
) -> Int[np.ndarray, "c"]:
    """Indices of the `settings.candidates` hypotheses of least verification cost, ascending.

    Votes rank a hypothesis by how many patches look right, wherever they come from; one rendering
    tells how well the whole object fits, for a hundredth of the price of refining it. Raises
    ValueError naming a hypothesis that is not finite or behind the camera.
    """
    if len(hypotheses) <= settings.candidates:
        return np.arange(len(hypotheses))
    poses = checked_poses(hypotheses)
    costs = [verify(model.proxy, depth, camera_matrix, pose, settings) for pose in poses]
    return np.sort(np.argsort(costs, kind="stable")[: settings.candidates])
