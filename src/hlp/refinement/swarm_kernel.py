"""Compiled steps of a particle swarm: its particles move, keep their bests, and are poses."""

import numpy as np
from jaxtyping import Float

from hlp.arrays import Point, Pose, Poses, Values
from hlp.kernels import compiled_ahead


@compiled_ahead()
def update_swarm(
    position: Float[np.ndarray, "n 6"],
    velocity: Float[np.ndarray, "n 6"],
    personal_best: Float[np.ndarray, "n 6"],
    global_best: Float[np.ndarray, "6"],
    random: Float[np.ndarray, "2 n 6"],
    phi: tuple[float, float],
    constriction: float,
) -> None:
    """Move the particles in place, within [-1, 1] (Kennedy & Eberhart 1995; Clerc & Kennedy 2002).

    `phi` are the weights of the personal and the global best; each is multiplied by a `random`
    number in [0, 1) for each particle and dimension.
    """
    for n in range(len(position)):
        for d in range(6):
            speed = velocity[n, d]
            speed += phi[0] * random[0, n, d] * (personal_best[n, d] - position[n, d])
            speed += phi[1] * random[1, n, d] * (global_best[d] - position[n, d])
            velocity[n, d] = speed * constriction
            position[n, d] = min(max(position[n, d] + velocity[n, d], -1.0), 1.0)


@compiled_ahead()
def update_personal_bests(
    position: Float[np.ndarray, "n 6"],
    cost: Values,
    personal_best: Float[np.ndarray, "n 6"],
    personal_best_cost: Values,
) -> int:
    """Update the personal bests and their costs in place; index of the global best."""
    best = 0
    for n in range(len(position)):
        if cost[n] < personal_best_cost[n]:
            personal_best_cost[n] = cost[n]
            for d in range(6):
                personal_best[n, d] = position[n, d]
        if personal_best_cost[n] < personal_best_cost[best]:
            best = n
    return best


@compiled_ahead()
def apply_offsets(pose_cam_obj: Pose, offsets: Float[np.ndarray, "n 6"], centroid: Point) -> Poses:
    """Poses for offsets (α, β, γ in rad, t_r in m) from one pose.

    R_r = R_x(α)·R_y(β)·R_z(γ) rotates the object about its `centroid` (object coordinates, m), then
    t_r shifts it, both in camera coordinates.
    """
    poses = np.zeros((len(offsets), 4, 4))
    rotation = np.empty((3, 3))
    center_cam = np.empty(3)
    for i in range(3):
        center_cam[i] = pose_cam_obj[i, 3]
        for k in range(3):
            center_cam[i] += pose_cam_obj[i, k] * centroid[k]
    for n in range(len(offsets)):
        sa, sb, sc = np.sin(offsets[n, 0]), np.sin(offsets[n, 1]), np.sin(offsets[n, 2])
        ca, cb, cc = np.cos(offsets[n, 0]), np.cos(offsets[n, 1]), np.cos(offsets[n, 2])
        rotation[0, 0], rotation[0, 1], rotation[0, 2] = cb * cc, -cb * sc, sb
        rotation[1, 0], rotation[1, 1] = ca * sc + sa * sb * cc, ca * cc - sa * sb * sc
        rotation[2, 0], rotation[2, 1] = sa * sc - ca * sb * cc, sa * cc + ca * sb * sc
        rotation[1, 2], rotation[2, 2] = -sa * cb, ca * cb
        for i in range(3):
            poses[n, i, 3] = center_cam[i] + offsets[n, 3 + i]
            for j in range(3):
                for k in range(3):
                    poses[n, i, j] += rotation[i, k] * pose_cam_obj[k, j]
                poses[n, i, 3] -= poses[n, i, j] * centroid[j]
        poses[n, 3, 3] = 1.0
    return poses
