"""Compiled mean shift in translation × rotation with a flat kernel.

Votes are stored by coordinate: `positions` (3, v) in m, `quats` (4, v) unit quaternions. Two votes
agree if their squared distance is at most `radius_squared` (m²) and the cosine of half the angle
between them is at least `cosine`. q and −q are the same rotation.
"""

import numpy as np
from jaxtyping import Float, Int

from hlp.compiled import compiled

# Allows the compiler to reorder sums, so that loops become vector instructions.
_FAST = {"reassoc", "contract", "nsz"}


@compiled(fastmath=_FAST)
def sum_support(
    positions: Float[np.ndarray, "3 v"],
    quats: Float[np.ndarray, "4 v"],
    weights: Float[np.ndarray, "v"],
    radius_squared: float,
    cosine: float,
    first: int,
    support: Float[np.ndarray, "n"],
) -> None:
    """Fill `support` with the total weight of the votes that agree with vote `first` + n."""
    x, y, z = positions[0], positions[1], positions[2]
    a, b, c, d = quats[0], quats[1], quats[2], quats[3]
    for n in range(len(support)):
        i, total = first + n, 0.0
        for j in range(len(weights)):
            squared = (x[i] - x[j]) ** 2 + (y[i] - y[j]) ** 2 + (z[i] - z[j]) ** 2
            dot = abs(a[i] * a[j] + b[i] * b[j] + c[i] * c[j] + d[i] * d[j])
            total += weights[j] if (squared <= radius_squared) & (dot >= cosine) else 0.0
        support[n] = total


@compiled()
def choose_distinct(
    positions: Float[np.ndarray, "3 v"],
    quats: Float[np.ndarray, "4 v"],
    support: Float[np.ndarray, "v"],
    radius_squared: float,
    cosine: float,
    limit: int,
) -> Int[np.ndarray, "s"]:
    """At most `limit` indices by falling support, none of which agrees with an earlier one."""
    chosen = np.empty(limit, dtype=np.int64)
    remaining = support.copy()
    for count in range(limit):
        best = np.argmax(remaining)
        if remaining[best] < 0.0:
            return chosen[:count]
        chosen[count] = best
        for j in range(len(remaining)):
            squared = 0.0
            for k in range(3):
                squared += (positions[k, best] - positions[k, j]) ** 2
            dot = 0.0
            for k in range(4):
                dot += quats[k, best] * quats[k, j]
            if squared <= radius_squared and abs(dot) >= cosine:
                remaining[j] = -1.0
    return chosen


@compiled()
def shift_modes(
    positions: Float[np.ndarray, "3 v"],
    quats: Float[np.ndarray, "4 v"],
    weights: Float[np.ndarray, "v"],
    radius_squared: float,
    cosine: float,
    steps: int,
    means: Float[np.ndarray, "s 7"],
    mode_support: Float[np.ndarray, "s"],
) -> None:
    """Shift each mean (position, quaternion) `steps` times; fill `mode_support` with its support.

    A mean that no vote agrees with any more jumps to the vote with the nearest position.
    """
    sums = np.empty(8)
    for s in range(len(means)):
        for shift in range(steps + 1):
            _sum_agreeing(positions, quats, weights, radius_squared, cosine, means[s], sums)
            if sums[7] <= 0.0:
                j = _nearest(positions, means[s])
                sums[:3], sums[3:7], sums[7] = positions[:, j], quats[:, j], 1.0
                sums *= weights[j]
            if shift < steps:
                means[s, :3] = sums[:3] / max(sums[7], 1e-12)
                means[s, 3:] = sums[3:7] / max(np.sqrt((sums[3:7] ** 2).sum()), 1e-12)
        mode_support[s] = sums[7]


@compiled(fastmath=_FAST)
def _sum_agreeing(
    positions: Float[np.ndarray, "3 v"],
    quats: Float[np.ndarray, "4 v"],
    weights: Float[np.ndarray, "v"],
    radius_squared: float,
    cosine: float,
    mean: Float[np.ndarray, "7"],
    sums: Float[np.ndarray, "8"],
) -> None:
    """Weighted sums of the agreeing votes: position (3), quaternion (4), weight.

    Of q and −q the one on the side of the mean's quaternion counts.
    """
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


@compiled()
def _nearest(positions: Float[np.ndarray, "3 v"], mean: Float[np.ndarray, "7"]) -> int:
    best, least = 0, np.inf
    for j in range(positions.shape[1]):
        squared = 0.0
        for k in range(3):
            squared += (positions[k, j] - mean[k]) ** 2
        if squared < least:
            best, least = j, squared
    return best
