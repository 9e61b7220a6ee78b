"""95 % intervals of recalls, and of their differences, over targets that are not independent."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float, Int

BLOCK = 20
"""Frames that are drawn together, at most (D)."""
_BLOCKS = 10  # at least, of which the resamples are made
_AT_ONCE = 1_000_000  # values of resamples in memory
Values = Bool[np.ndarray, "n"] | Float[np.ndarray, "n"]


def blocks_of(frames: Sequence[tuple[int, int]]) -> Int[np.ndarray, "n"]:
    """The block, numbered from 0, of each of n targets, given its scene and its frame's number.

    A block is `BLOCK` neighbouring frames of a scene, or as many as leave ten blocks in all.
    Neighbouring frames of a video show nearly the same: drawn one by one they would count as more
    than they tell (the block bootstrap of Carlstein 1986).
    """
    unique, target_frames = np.unique(np.asarray(frames), axis=0, return_inverse=True)
    scenes = unique[:, 0]
    places = np.arange(len(unique)) - np.searchsorted(scenes, scenes)
    size = min(BLOCK, max(len(unique) // _BLOCKS, 1))
    blocks = np.unique(np.stack([scenes, places // size], axis=1), axis=0, return_inverse=True)[1]
    return np.asarray(blocks.ravel()[target_frames.ravel()])


def recall_interval(
    right: Bool[np.ndarray, "n"], blocks: Int[np.ndarray, "n"], resamplings: int, seed: int
) -> tuple[float, float]:
    """95 % interval of the recall over n targets, by the percentile bootstrap over blocks.

    Where all or none are right every resample is the same; then it is Wilson's.
    """
    if right.all() or not right.any():
        return wilson(float(right[0]), len(right))
    return _bootstrap(right.astype(float), blocks, resamplings, seed)


def difference_interval(
    first: Values, second: Values, blocks: Int[np.ndarray, "n"], resamplings: int, seed: int
) -> tuple[float, float]:
    """95 % interval of second's mean minus first's: the percentile bootstrap over blocks.

    Of verdicts, the mean is the recall. Blocks are resampled with all their targets and both values
    of each (paired).
    """
    return _bootstrap(second.astype(float) - first.astype(float), blocks, resamplings, seed)


def median_difference_interval(
    first: Values, second: Values, blocks: Int[np.ndarray, "n"], resamplings: int, seed: int
) -> tuple[float, float]:
    """As `difference_interval`, of medians."""
    order, counts = np.argsort(blocks, kind="stable"), np.bincount(blocks)
    place = np.arange(len(blocks)) - np.repeat(np.cumsum(counts) - counts, counts)
    padded = np.full((2, len(counts), counts.max()), np.nan)
    padded[:, blocks[order], place] = np.stack([first, second])[:, order]
    rng = np.random.default_rng(seed)
    drawn = rng.integers(len(counts), size=(resamplings, len(counts)))
    differences = []
    for some in np.array_split(drawn, max(1, padded[0].size * resamplings // _AT_ONCE)):
        medians = np.nanmedian(padded[:, some].reshape(2, len(some), -1), axis=-1)
        differences.append(medians[1] - medians[0])
    low, high = np.percentile(np.concatenate(differences), [2.5, 97.5])
    return float(low), float(high)


def wilson(recall: float, targets: int) -> tuple[float, float]:
    """Wilson's 95 % interval of a recall over independent targets (Wilson 1927)."""
    from scipy.stats import binomtest  # takes half a second to import

    ends = binomtest(round(recall * targets), targets).proportion_ci(0.95, method="wilson")
    return float(ends.low), float(ends.high)


def _bootstrap(
    values: Float[np.ndarray, "n"], blocks: Int[np.ndarray, "n"], resamplings: int, seed: int
) -> tuple[float, float]:
    """Percentile interval of the mean value over targets, whose blocks are resampled."""
    sums, counts = np.bincount(blocks, values), np.bincount(blocks)
    drawn = np.random.default_rng(seed).integers(len(counts), size=(resamplings, len(counts)))
    means: Float[np.ndarray, "r"] = sums[drawn].sum(axis=1) / counts[drawn].sum(axis=1)
    low, high = np.percentile(means, [2.5, 97.5])
    return float(low), float(high)
