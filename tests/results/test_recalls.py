"""Intervals beside SciPy's bootstrap, resampling everything, and the binomial's; `targets.csv`."""

import itertools
import math
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import bootstrap

from hlp.errors import DataError
from hlp.records import TargetScore
from hlp.results.recalls import (
    BLOCK,
    add_verdicts,
    blocks_of,
    difference_interval,
    numbered_targets,
    read_target_values,
    recall_interval,
    wilson,
    write_target_values,
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
        random_state=np.random.default_rng(1),
    ).confidence_interval
    np.testing.assert_allclose(recall_interval(right, blocks, 20_000, 2), theirs, atol=0.008)


def test_no_interval_has_zero_width() -> None:
    """Each of three frames has six of its seven targets right, and gains one of the seven."""
    blocks, right = blocks_of([(1, i // 7) for i in range(21)]), np.arange(21) % 7 > 0
    assert recall_interval(right, blocks, 100, 0) == wilson(6 / 7, 21)
    z2 = 1.959964**2
    assert recall_interval(np.full(21, True), blocks, 100, 0) == pytest.approx((21 / (21 + z2), 1))
    low, high = difference_interval(right, np.full(21, True), blocks, 100, 0)
    gained, lost = wilson(1 / 7, 21), wilson(0.0, 21)
    assert low == pytest.approx(1 / 7 - math.hypot(1 / 7 - gained[0], lost[1]))
    assert high == pytest.approx(gained[1])
    assert low < 0.0  # three targets more of 21 are not surely better
    assert len({*blocks_of([(1, 5)] * 21)}) == 21  # a single frame leaves nothing else to draw


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


def test_values_are_read_as_they_were_written(tmp_path: Path) -> None:
    values = {
        "est/est": {(1, 4, 2, 0): 1.0, (1, 4, 2, 1): 0.0},
        "ms first": {(1, 4, 2, 0): 0.1 + 0.2},
        "none": {},
    }
    assert read_target_values(tmp_path) == {}
    write_target_values(tmp_path, values, {2: 'cup, "red"'})
    assert read_target_values(tmp_path) == values
    first = (tmp_path / "targets.csv").read_text().splitlines()[0]
    assert first == "scene_id,im_id,obj_id,instance,object,est/est,ms first,none"


def test_each_target_has_its_verdict() -> None:
    scores = [
        TargetScore(1, 4, 2, True, 1.0, 0.0, 0.0, 0.0, 1.0, right, True, True)
        for right in (True, False)
    ]
    assert add_verdicts(scores) == {(1, 4, 2, 0): 1.0, (1, 4, 2, 1): 0.0}


def test_instances_are_numbered_in_their_order() -> None:
    targets = [(1, 4, 2), (1, 4, 3), (1, 4, 2), (1, 5, 2)]
    assert numbered_targets(targets) == [(1, 4, 2, 0), (1, 4, 3, 0), (1, 4, 2, 1), (1, 5, 2, 0)]


HEADER = "scene_id,im_id,obj_id,instance,object,pso\n"


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("", "first line must be scene_id"),
        ("scene_id,im_id\n1,2\n", "first line must be scene_id"),
        (f"{HEADER}1,1,1,0,cat,0.5\n1,1,one,0,cat,0.5\n", "line 3: no target .*one"),
        (f"{HEADER}1,1,1,0,cat,much\n", "line 2: no target .*much"),
        (f"{HEADER}1,1,1,0,cat\n", "line 2: it must have 6 cells"),
        (f"{HEADER}1,1,1,0,cat,nan\n", "line 2: a value is not finite"),
    ],
)
def test_a_damaged_file_is_named(content: str, message: str, tmp_path: Path) -> None:
    (tmp_path / "targets.csv").write_text(content)
    with pytest.raises(DataError, match=rf"targets\.csv.*{message}"):
        read_target_values(tmp_path)
