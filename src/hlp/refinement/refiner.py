"""What every refiner offers: coarse poses in, as many refined poses out; the answer polished."""

from typing import Protocol

import numpy as np
from jaxtyping import Float

from hlp.records import Hypotheses, ObjectModel, Refinement


class Refiner(Protocol):
    """Stage 3: moves coarse poses until the rendered model fits the observed depth."""

    def refine(
        self,
        model: ObjectModel,
        depth: Float[np.ndarray, "h w"],
        camera_matrix: Float[np.ndarray, "3 3"],
        hypotheses: Hypotheses,
        seed: int,
        spent: float = 0.0,
    ) -> list[Refinement]:
        """One refinement per hypothesis, in the same order.

        `depth` in metres, 0 where missing. Where the refiner has a budget of time, `spent` (s) of
        it belongs to other work. Without one, equal inputs and seeds give equal poses. Raises
        ValueError naming a hypothesis that is not finite or behind the camera.
        """
        ...

    def polish(
        self,
        model: ObjectModel,
        depth: Float[np.ndarray, "h w"],
        camera_matrix: Float[np.ndarray, "3 3"],
        answer: Refinement,
        seed: int,
        spent: float = 0.0,
    ) -> Refinement:
        """The answer, once chosen, made more exact; here itself: there is nothing to add."""
        return answer


def checked_poses(hypotheses: Hypotheses) -> Float[np.ndarray, "m 4 4"]:
    """The coarse poses as float64; raises ValueError naming the first that cannot be refined."""
    poses = np.asarray(hypotheses.poses_cam_obj, dtype=np.float64)
    for index, pose in enumerate(poses):
        if not np.isfinite(pose).all():
            raise ValueError(f"hypothesis {index}: pose_cam_obj is not finite (nan or inf)")
        if pose[2, 3] <= 0.0:
            raise ValueError(f"hypothesis {index}: pose_cam_obj lies behind the camera")
    return poses
