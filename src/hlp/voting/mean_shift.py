"""Mean shift in translation × rotation with a flat kernel, compiled."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from hlp.arrays import Points, Values
from hlp.kernels import compiled, compiled_ahead
from hlp.threads import ThreadTeam

# Allows the compiler to reorder sums, so that loops become vector instructions.
_FAST = {"reassoc", "contract", "nsz"}
_SEEDS_PER_MODE = 4


class KernelVotes(NamedTuple):
    """Votes by coordinate, and when two of them agree.

    `positions` are in m, `quats` unit quaternions; q and −q are the same rotation. Two votes agree
    if their squared distance is at most `radius_squared` (m²) and the cosine of half the angle
    between them is at least `cosine`.
    """

    positions: Float[np.ndarray, "3 v"]
    quats: Float[np.ndarray, "4 v"]
    weights: Values
    radius_squared: float
    cosine: float


def find_modes(
    centroids: Points,
    quats: Float[np.ndarray, "v 4"],
    weights: Values,
    radius_squared: float,
    cosine: float,
    steps: int,
    limit: int,
    team: ThreadTeam,
) -> tuple[Float[np.ndarray, "m 7"], Values]:
    """At most `limit` distinct modes (centroid, quaternion) of votes, and the weight at each.

    Votes agree as in `KernelVotes`; with a cosine of 0 rotations do not matter, with an infinite
    radius centroids do not. The mode of most weight comes first. Each mean shift takes `steps`.
    """
    columns = np.ascontiguousarray(centroids.T), np.ascontiguousarray(quats.T)
    votes = KernelVotes(*columns, weights, radius_squared, cosine)
    support = np.empty(len(weights))
    team.map_ranges(lambda a, b: sum_support(votes, a, support[a:b]), len(support))
    # More seeds than requested modes, because several may shift to the same mode.
    order = np.argsort(-support, kind="stable")
    seeds = choose_distinct(votes, order, _SEEDS_PER_MODE * limit)
    means, found = np.hstack([centroids[seeds], quats[seeds]]), np.empty(len(seeds))
    team.map_ranges(lambda a, b: shift_modes(votes, steps, means[a:b], found[a:b]), len(seeds))
    columns = np.ascontiguousarray(means[:, :3].T), np.ascontiguousarray(means[:, 3:].T)
    votes = KernelVotes(*columns, found, radius_squared, cosine)
    kept = choose_distinct(votes, np.argsort(-found, kind="stable"), limit)
    return means[kept], found[kept]


@compiled_ahead(fastmath=_FAST)
def sum_support(votes: KernelVotes, first: int, support: Values) -> None:
    """Fill `support` with the total weight of the votes that agree with vote `first` + n."""
    positions, quats, weights, radius_squared, cosine = votes
    x, y, z = positions[0], positions[1], positions[2]
    a, b, c, d = quats[0], quats[1], quats[2], quats[3]
    for n in range(len(support)):
        i, total = first + n, 0.0
        for j in range(len(weights)):
            squared = (x[i] - x[j]) ** 2 + (y[i] - y[j]) ** 2 + (z[i] - z[j]) ** 2
            dot = abs(a[i] * a[j] + b[i] * b[j] + c[i] * c[j] + d[i] * d[j])
            total += weights[j] if (squared <= radius_squared) & (dot >= cosine) else 0.0
        support[n] = total


@compiled_ahead()
def choose_distinct(
    votes: KernelVotes, order: Int[np.ndarray, "v"], limit: int
) -> Int[np.ndarray, "s"]:
    """At most `limit` indices of an order, none of which agrees with an earlier one."""
    x, y, z = votes.positions[0], votes.positions[1], votes.positions[2]
    a, b, c, d = votes.quats[0], votes.quats[1], votes.quats[2], votes.quats[3]
    chosen, count = np.empty(limit, dtype=np.int64), 0
    free = np.ones(len(order), dtype=np.bool_)
    for i in order:
        if count == limit:
            break
        if free[i]:
            chosen[count] = i
            count += 1
            for j in range(len(order)):
                squared = (x[i] - x[j]) ** 2 + (y[i] - y[j]) ** 2 + (z[i] - z[j]) ** 2
                dot = abs(a[i] * a[j] + b[i] * b[j] + c[i] * c[j] + d[i] * d[j])
                free[j] &= (squared > votes.radius_squared) | (dot < votes.cosine)
    return chosen[:count]


@compiled_ahead()
def shift_modes(
    votes: KernelVotes, steps: int, means: Float[np.ndarray, "s 7"], mode_support: Values
) -> None:
    """Shift each mean (position, quaternion) `steps` times; fill `mode_support` with its support.

    A mean that no vote agrees with any more jumps to the vote with the nearest position.
    """
    positions, quats, weights = votes.positions, votes.quats, votes.weights
    x, y, z = positions[0], positions[1], positions[2]
    sums = np.empty(8)
    for s in range(len(means)):
        for shift in range(steps + 1):
            _sum_agreeing(votes, means[s], sums)
            if sums[7] <= 0.0:
                at = means[s]
                j = np.argmin((x - at[0]) ** 2 + (y - at[1]) ** 2 + (z - at[2]) ** 2)
                for k in range(7):
                    sums[k] = (positions[k, j] if k < 3 else quats[k - 3, j]) * weights[j]
                sums[7] = weights[j]
            if shift < steps:
                squared, moved = 0.0, False
                for k in range(3, 7):
                    squared += sums[k] * sums[k]
                for k in range(7):
                    length = sums[7] if k < 3 else np.sqrt(squared)
                    mean = sums[k] / max(length, 1e-12)
                    moved |= mean != means[s, k]
                    means[s, k] = mean
                if not moved:  # nor will it
                    break
        mode_support[s] = sums[7]


@compiled(fastmath=_FAST)
def _sum_agreeing(
    votes: KernelVotes, mean: Float[np.ndarray, "7"], sums: Float[np.ndarray, "8"]
) -> None:
    """Weighted sums of the agreeing votes: position (3), quaternion (4), weight.

    Of q and −q the one on the side of the mean's quaternion counts.
    """
    positions, quats, weights, radius_squared, cosine = votes
    x, y, z = positions[0], positions[1], positions[2]
    a, b, c, d = quats[0], quats[1], quats[2], quats[3]
    u, v, w, e, f, g, h = mean[0], mean[1], mean[2], mean[3], mean[4], mean[5], mean[6]
    sx, sy, sz, sa, sb, sc, sd, total = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for j in range(len(weights)):
        squared = (x[j] - u) ** 2 + (y[j] - v) ** 2 + (z[j] - w) ** 2
        dot = a[j] * e + b[j] * f + c[j] * g + d[j] * h
        weight = weights[j] if (squared <= radius_squared) & (abs(dot) >= cosine) else 0.0
        signed = weight if dot >= 0.0 else -weight
        sx, sy, sz = sx + weight * x[j], sy + weight * y[j], sz + weight * z[j]
        sa, sb = sa + signed * a[j], sb + signed * b[j]
        sc, sd = sc + signed * c[j], sd + signed * d[j]
        total += weight
    sums[0], sums[1], sums[2], sums[7] = sx, sy, sz, total
    sums[3], sums[4], sums[5], sums[6] = sa, sb, sc, sd
