"""Compiled part of the swarm: its particles' flight, and the poses that they stand for."""

import numpy as np
from jaxtyping import Float
from numba import njit


@njit(nogil=True, cache=True)
def update_swarm(
    position: Float[np.ndarray, "n 6"],
    velocity: Float[np.ndarray, "n 6"],
    personal_best: Float[np.ndarray, "n 6"],
    global_best: Float[np.ndarray, "6"],
    random: Float[np.ndarray, "2 n 6"],
    phi: tuple[float, float],
    constriction: float,
) -> None:
    """Move particles in place, within [-1, 1] (Kennedy & Eberhart 1995; Clerc & Kennedy 2002).

    Each is pulled to its own best and to the swarm's (`global_best`), by `phi` times a `random` in
    [0, 1) for each particle and dimension.
    """
    for n in range(len(position)):
        for d in range(6):
            pace = velocity[n, d]
            pace += phi[0] * random[0, n, d] * (personal_best[n, d] - position[n, d])
            pace += phi[1] * random[1, n, d] * (global_best[d] - position[n, d])
            velocity[n, d] = pace * constriction
            position[n, d] = min(max(position[n, d] + velocity[n, d], -1.0), 1.0)


@njit(nogil=True, cache=True)
def update_personal_bests(
    position: Float[np.ndarray, "n 6"],
    cost: Float[np.ndarray, "n"],
    personal_best: Float[np.ndarray, "n 6"],
    personal_best_cost: Float[np.ndarray, "n"],
) -> int:
    """Overwrite the particles' own bests where they are bettered; index of the swarm's best."""
    best = 0
    for n in range(len(position)):
        if cost[n] < personal_best_cost[n]:
            personal_best_cost[n] = cost[n]
            personal_best[n] = position[n]
        if personal_best_cost[n] < personal_best_cost[best]:
            best = n
    return best


@njit(nogil=True, cache=True)
def moved(
    pose_cam_obj: Float[np.ndarray, "4 4"],
    steps: Float[np.ndarray, "n 6"],
    centroid: Float[np.ndarray, "3"],
) -> Float[np.ndarray, "n 4 4"]:
    """Poses R_r·R_0, t_0 + t_r for steps (α, β, γ rad, t_r m), R_r = R_x(α)·R_y(β)·R_z(γ).

    R_r turns about the object's centroid (object coordinates), t_r moves the centroid.
    """
    poses = np.zeros((len(steps), 4, 4))
    turn = np.empty((3, 3))
    middle = np.empty(3)
    for i in range(3):
        middle[i] = pose_cam_obj[i, 3]
        for k in range(3):
            middle[i] += pose_cam_obj[i, k] * centroid[k]
    for n in range(len(steps)):
        sa, sb, sc = np.sin(steps[n, 0]), np.sin(steps[n, 1]), np.sin(steps[n, 2])
        ca, cb, cc = np.cos(steps[n, 0]), np.cos(steps[n, 1]), np.cos(steps[n, 2])
        turn[0, 0], turn[0, 1], turn[0, 2] = cb * cc, -cb * sc, sb
        turn[1, 0], turn[1, 1] = ca * sc + sa * sb * cc, ca * cc - sa * sb * sc
        turn[2, 0], turn[2, 1] = sa * sc - ca * sb * cc, sa * cc + ca * sb * sc
        turn[1, 2], turn[2, 2] = -sa * cb, ca * cb
        for i in range(3):
            poses[n, i, 3] = middle[i] + steps[n, 3 + i]
            for j in range(3):
                for k in range(3):
                    poses[n, i, j] += turn[i, k] * pose_cam_obj[k, j]
                poses[n, i, 3] -= poses[n, i, j] * centroid[j]
        poses[n, 3, 3] = 1.0
    return poses
