"""A search for a pose of lower cost by successive parabolas: few costs, nothing random."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated

import numpy as np
from annotated_types import Le
from jaxtyping import Float

from hlp.arrays import Point, Pose
from hlp.refinement.cost import DepthCost
from hlp.refinement.swarm_kernel import apply_offsets
from hlp.settings import Count, Doc, NotNegative, Settings, WholeNumber

_FLAT = 1e-9  # bend of a parabola: with less it has no lowest point

Offset = Float[np.ndarray, "6"]
"""Three angles (rad) and three distances (m), see `apply_offsets`."""


@dataclass(frozen=True)
class DescentSettings(Settings):
    """A search by parabolas (`descend`) (D)."""

    theta_deg: Annotated[NotNegative, Doc("largest step in rotation (D)")] = 5.0
    tau_mm: Annotated[NotNegative, Doc("largest step in translation (D)")] = 5.0
    patience: Annotated[
        WholeNumber, Doc("iterations with little gain before stopping; each halves the steps (D)")
    ] = 5
    iterations: Annotated[Count, Le(10_000), Doc("largest number of iterations (D)")] = 12


def descend(
    cost: DepthCost,
    pose_cam_obj: Pose,
    centroid: Point,
    settings: DescentSettings,
    goes_on: Callable[[int, float, Pose], bool] = lambda *_: True,
) -> tuple[Pose, int]:
    """A pose near one that costs no more, found by parabolas, and the number of iterations.

    The cost is taken one step back and forth along each of the six offsets. The pose then moves to
    the cheapest of these: the lowest points of the six parabolas through them, each at most a step
    away; half of that; the best single step; and half way between it and the first. Where none of
    them costs less, or shorter steps would do, steps are halved. Before each iteration `goes_on` is
    asked: given their number, the lowest cost and its pose.
    """
    steps = offset_box(settings.theta_deg, settings.tau_mm)
    pose, lowest = pose_cam_obj, float(cost.evaluate(pose_cam_obj[None])[0])
    single = np.concatenate([np.eye(6), -np.eye(6)])
    idle, iteration = 0, 0
    while iteration < settings.iterations and idle < settings.patience:
        if not goes_on(iteration, lowest, pose):
            break
        iteration += 1
        scale = steps / 2.0**idle
        costs = cost.evaluate(apply_offsets(pose, single * scale, centroid))
        slope, bend = (costs[:6] - costs[6:]) / 2.0, costs[:6] + costs[6:] - 2.0 * lowest
        bottom = -slope / np.maximum(bend, _FLAT)  # far away where there is none
        bottom = np.clip(bottom, -1.0, 1.0)
        best = single[costs.argmin()] * (costs.min() < lowest)
        tried = np.stack([bottom, bottom / 2.0, best, (bottom + best) / 2.0])
        poses = apply_offsets(pose, tried * scale, centroid)
        costs = cost.evaluate(poses)
        row = int(costs.argmin())
        if costs[row] >= lowest:
            idle += 1
            continue
        pose, lowest = poses[row], float(costs[row])
        idle += int(np.abs(tried[row]).max() < 0.5)
    return pose, iteration


def offset_box(theta_deg: float, tau_mm: float) -> Offset:
    """Half the sides of a box, of three angles (rad) and three distances (m)."""
    return np.repeat([np.deg2rad(theta_deg), tau_mm / 1000.0], 3)
