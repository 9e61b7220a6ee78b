"""Compiled mean shift in translation × rotation, with a flat kernel, over all votes at once.

Votes are held by coordinate: `places` (3, v) in m, `turns` (4, v) unit quaternions. Two votes agree
where their squared distance is at most `radius_squared` and the cosine of half the angle between them at
least `cosine`. q and −q are one rotation.
"""

import numpy as np
from jaxtyping import Float, Int
from numba import njit

# Sums may be taken in another order, as vectors need.
_FAST = {"reassoc", "contract", "nsz"}


@njit(nogil=True, cache=True, fastmath=_FAST)
def sum_support(
    places: Float[np.ndarray, "3 v"],
    turns: Float[np.ndarray, "4 v"],
    weights: Float[np.ndarray, "v"],
    radius_squared: float,
    cosine: float,
    first: int,
    support: Float[np.ndarray, "n"],
) -> None:
    """Fill `support` with the weight of the votes that agree with each, from vote `first` on."""
    x, y, z = places[0], places[1], places[2]
    a, b, c, d = turns[0], turns[1], turns[2], turns[3]
    for n in range(len(support)):
        i, total = first + n, 0.0
        for j in range(len(weights)):
            apart = (x[i] - x[j]) ** 2 + (y[i] - y[j]) ** 2 + (z[i] - z[j]) ** 2
            alike = abs(a[i] * a[j] + b[i] * b[j] + c[i] * c[j] + d[i] * d[j])
            total += weights[j] if (apart <= radius_squared) & (alike >= cosine) else 0.0
        support[n] = total


@njit(nogil=True, cache=True)
def choose_distinct(
    places: Float[np.ndarray, "3 v"],
    turns: Float[np.ndarray, "4 v"],
    support: Float[np.ndarray, "v"],
    radius_squared: float,
    cosine: float,
    most: int,
) -> Int[np.ndarray, "s"]:
    """Indices of most support, best first, none that agrees with a better one; at most `most`."""
    chosen = np.empty(most, dtype=np.int64)
    free = support.copy()
    for count in range(most):
        best = np.argmax(free)
        if free[best] < 0.0:
            return chosen[:count]
        chosen[count] = best
        for j in range(len(free)):
            apart = 0.0
            for k in range(3):
                apart += (places[k, best] - places[k, j]) ** 2
            alike = 0.0
            for k in range(4):
                alike += turns[k, best] * turns[k, j]
            if apart <= radius_squared and abs(alike) >= cosine:
                free[j] = -1.0
    return chosen


@njit(nogil=True, cache=True)
def shift_modes(
    places: Float[np.ndarray, "3 v"],
    turns: Float[np.ndarray, "4 v"],
    weights: Float[np.ndarray, "v"],
    radius_squared: float,
    cosine: float,
    steps: int,
    means: Float[np.ndarray, "s 7"],
    mode_support: Float[np.ndarray, "s"],
) -> None:
    """Move each mean (place, quaternion) `steps` times; `mode_support` is the weight about it then.

    A mean that drifted away from all votes goes to its nearest one.
    """
    sums = np.empty(8)
    for s in range(len(means)):
        for shift in range(steps + 1):
            _sum_agreeing(places, turns, weights, radius_squared, cosine, means[s], sums)
            if sums[7] <= 0.0:
                j = _nearest(places, means[s])
                sums[:3], sums[3:7], sums[7] = places[:, j], turns[:, j], 1.0
                sums *= weights[j]
            if shift < steps:
                means[s, :3] = sums[:3] / max(sums[7], 1e-12)
                means[s, 3:] = sums[3:7] / max(np.sqrt((sums[3:7] ** 2).sum()), 1e-12)
        mode_support[s] = sums[7]


@njit(nogil=True, cache=True, fastmath=_FAST)
def _sum_agreeing(
    places: Float[np.ndarray, "3 v"],
    turns: Float[np.ndarray, "4 v"],
    weights: Float[np.ndarray, "v"],
    radius_squared: float,
    cosine: float,
    mean: Float[np.ndarray, "7"],
    sums: Float[np.ndarray, "8"],
) -> None:
    """Sums of the agreeing votes' places and quaternions (on the mean's side), and their weight."""
    x, y, z = places[0], places[1], places[2]
    a, b, c, d = turns[0], turns[1], turns[2], turns[3]
    u, v, w, e, f, g, h = mean[0], mean[1], mean[2], mean[3], mean[4], mean[5], mean[6]
    sx, sy, sz, sa, sb, sc, sd, total = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for j in range(len(weights)):
        apart = (x[j] - u) ** 2 + (y[j] - v) ** 2 + (z[j] - w) ** 2
        alike = a[j] * e + b[j] * f + c[j] * g + d[j] * h
        own = weights[j] if (apart <= radius_squared) & (abs(alike) >= cosine) else 0.0
        turned = own if alike >= 0.0 else -own
        sx, sy, sz, total = sx + own * x[j], sy + own * y[j], sz + own * z[j], total + own
        sa, sb, sc, sd = (
            sa + turned * a[j],
            sb + turned * b[j],
            sc + turned * c[j],
            sd + turned * d[j],
        )
    sums[0], sums[1], sums[2], sums[7] = sx, sy, sz, total
    sums[3], sums[4], sums[5], sums[6] = sa, sb, sc, sd


@njit(nogil=True, cache=True)
def _nearest(places: Float[np.ndarray, "3 v"], mean: Float[np.ndarray, "7"]) -> int:
    best, least = 0, np.inf
    for j in range(places.shape[1]):
        apart = 0.0
        for k in range(3):
            apart += (places[k, j] - mean[k]) ** 2
        if apart < least:
            best, least = j, apart
    return best
