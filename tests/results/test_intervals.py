"""Intervals beside SciPy's bootstrap, a resampling of everything, and the binomial's."""

import itertools
import math

import numpy as np
import pytest
from scipy.stats import bootstrap

from hlp.results.summary_file import (
    BLOCK,
    blocks_of,
    difference_interval,
    median_difference_interval,
    recall_interval,
    wilson,
)


def test_blocks_are_neighbours_of_one_scene_in_any_order() -> None:
    frames = [(scene, 3 * i) for scene in (1, 2) for i in range(50)]
    blocks = blocks_of(frames)
    expected = [i // 10 for i in range(50)] + [5 + i // 10 for i in range(50)]  # 100 frames
    np.testing.assert_array_equal(blocks, expected)
    order = np.random.default_rng(0).permutation(100)
    np.testing.assert_array_equal(blocks_of([frames[i] for i in order]), blocks[order])
    np.testing.assert_array_equal(blocks_of([*frames, frames[7]])[[-1, 7]], [0, 0])


@pytest.mark.parametrize(
    ("frames", "size"), [(1, 1), (19, 1), (29, 2), (202, BLOCK), (9999, BLOCK)]
)
def test_a_block_leaves_ten_of_them_and_has_no_more_than_twenty_frames(
    frames: int, size: int
) -> None:
    assert np.bincount(blocks_of([(0, i) for i in range(frames)]))[0] == size


def test_the_recalls_interval_is_scipys_over_blocks() -> None:
    rng = np.random.default_rng(0)
    blocks = np.repeat(np.arange(30), rng.integers(1, 6, 30))
    right = rng.random(len(blocks)) < 0.3 + 0.6 * (blocks % 2)
    sums, counts = np.bincount(blocks, right), np.bincount(blocks)

    def recall(sums: np.ndarray, counts: np.ndarray, axis: int) -> np.ndarray:
        return np.asarray(sums.sum(axis=axis) / counts.sum(axis=axis))

    theirs = bootstrap(
        (sums, counts),
        recall,
        paired=True,
        vectorized=True,
        n_resamples=20_000,
        method="percentile",
        rng=np.random.default_rng(1),
    ).confidence_interval
    np.testing.assert_allclose(recall_interval(right, blocks, 20_000, 2), theirs, atol=0.008)


@pytest.mark.parametrize("right", [True, False])
def test_where_all_agree_it_is_wilsons(right: bool) -> None:
    verdicts = np.full(19, right)
    low, high = recall_interval(verdicts, np.arange(19), 100, 0)
    z2 = 1.959964**2
    margin = z2 / (19 + z2)  # Wilson's interval of 0 or 19 of 19
    assert (low, high) == pytest.approx((1 - margin, 1.0) if right else (0.0, margin), abs=1e-6)


@pytest.mark.parametrize(("recall", "targets"), [(0.9, 20), (1.0, 20), (0.0, 7)])
def test_wilson_is_its_formula(recall: float, targets: int) -> None:
    """Wilson (1927), written out with z = 1.959964."""
    z = 1.959964
    centre = (recall + z**2 / (2 * targets)) / (1 + z**2 / targets)
    half = math.sqrt(recall * (1 - recall) / targets + z**2 / (4 * targets**2))
    half *= z / (1 + z**2 / targets)
    assert wilson(recall, targets) == pytest.approx((centre - half, centre + half), abs=1e-6)


def test_a_differences_interval_is_that_of_all_resamples() -> None:
    """Five blocks have 5⁵ resamples: the interval from every one of them, each as likely."""
    blocks = np.array([0, 0, 0, 1, 1, 2, 3, 3, 3, 3, 4])
    first = np.array([1, 0, 0, 1, 0, 0, 1, 1, 0, 0, 1], dtype=bool)
    second = np.array([1, 1, 1, 0, 0, 1, 1, 1, 0, 1, 0], dtype=bool)
    differences = []
    for drawn in itertools.product(range(5), repeat=5):
        chosen = np.concatenate([np.flatnonzero(blocks == block) for block in drawn])
        differences.append(second[chosen].mean() - first[chosen].mean())
    exact = np.percentile(differences, [2.5, 97.5])
    found = difference_interval(first, second, blocks, 20_000, seed=1)
    np.testing.assert_allclose(found, exact, atol=0.02)


def test_a_difference_of_medians_has_the_interval_of_all_resamples() -> None:
    blocks = np.array([3, 0, 0, 1, 1, 2, 3, 3, 0, 3, 4])  # in any order
    rng = np.random.default_rng(0)
    first, second = rng.gamma(3.0, 10.0, (2, 11))
    differences = []
    for drawn in itertools.product(range(5), repeat=5):
        chosen = np.concatenate([np.flatnonzero(blocks == block) for block in drawn])
        differences.append(np.median(second[chosen]) - np.median(first[chosen]))
    exact = np.percentile(differences, [2.5, 97.5])
    found = median_difference_interval(first, second, blocks, 20_000, seed=1)
    np.testing.assert_allclose(found, exact, atol=0.05 * np.ptp(exact))


def test_medians_of_many_targets_are_drawn_in_parts(monkeypatch: pytest.MonkeyPatch) -> None:
    rng = np.random.default_rng(0)
    first, second = rng.gamma(3.0, 10.0, (2, 90))
    blocks = np.repeat(np.arange(30), 3)
    whole = median_difference_interval(first, second, blocks, 500, seed=0)
    monkeypatch.setattr("hlp.results.summary_file._AT_ONCE", 900)
    assert median_difference_interval(first, second, blocks, 500, seed=0) == whole
