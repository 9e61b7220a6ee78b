"""What answers tell of each other: parts side by side, and in one colour, vouch for each other."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from hlp.method.find.answers import arrangement_evidence, likeness_evidence, stand_side_by_side
from refinement_scene import make_model, posed

MODEL = make_model()
SIZE = np.ptp(MODEL.proxy.vertices, axis=0)
TURN = Rotation.from_euler("xyz", [0.4, -0.7, 1.1])
PLACE = np.array([0.02, -0.03, 0.7])
HALF_TURN = np.diag([1.0, -1.0, -1.0, 1.0])
HALF_TURN[:3, 3] = MODEL.centroid - HALF_TURN[:3, :3] @ MODEL.centroid


def beside(shift, turn=(0.0, 0.0, 0.0), model=MODEL):
    """Whether a part that is shifted (in sizes) and turned (degrees) stands beside another."""
    rotation = TURN * Rotation.from_euler("xyz", turn, degrees=True)
    place = PLACE + TURN.apply(np.array(shift) * SIZE)
    first, second = posed(model, TURN.as_matrix(), PLACE), posed(model, rotation.as_matrix(), place)
    found = stand_side_by_side(model, np.stack([first, second]))
    assert not found.diagonal().any()
    return bool(found[0, 1]), bool(found[1, 0])


@pytest.mark.parametrize("axis", range(3))
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_part_one_size_off_along_any_of_its_axes_stands_beside(axis, sign):
    shift = np.zeros(3)
    shift[axis] = 1.1 * sign
    assert beside(shift) == (True, True)
    shift[axis - 1] = 0.1
    assert beside(shift, (3.0, -4.0, 5.0)) == (True, True)


@pytest.mark.parametrize(
    ("shift", "turn"),
    [
        ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0)),  # in the same place
        ((1.0, 1.0, 0.0), (0.0, 0.0, 0.0)),  # touches along an edge alone
        ((1.35, 0.0, 0.0), (0.0, 0.0, 0.0)),  # apart
        ((0.5, 0.0, 0.0), (0.0, 0.0, 0.0)),  # half in the other
        ((0.0, 1.0, 0.4), (0.0, 0.0, 0.0)),  # shifted along the face
        ((1.0, 0.0, 0.0), (0.0, 0.0, 20.0)),  # turned
        ((1.0, 0.0, 0.0), (180.0, 0.0, 0.0)),
    ],
)
def test_what_is_elsewhere_or_turned_does_not(shift, turn):
    assert beside(shift, turn) == (False, False)


def test_a_symmetry_is_no_turn():
    model = replace(MODEL, symmetries=np.stack([np.eye(4), HALF_TURN]))
    assert beside((0.0, -1.0, 0.0), (180.0, 0.0, 0.0), model) == (True, True)
    assert beside((0.0, -1.0, 0.0), (0.0, 180.0, 0.0), model) == (False, False)


def chain(count, length):
    """Of `count` answers the first `length` stand in a row."""
    row = np.zeros((count, count), dtype=bool)
    places = np.arange(length - 1)
    row[places, places + 1] = row[places + 1, places] = True
    return row


def test_without_neighbours_nothing_is_told():
    logits = np.array([3.0, 0.0, -2.0])
    none = arrangement_evidence(np.zeros((3, 3), bool), logits, logits > 0, True)
    np.testing.assert_allclose(none, 0.0, atol=1e-12)
    alone = arrangement_evidence(np.zeros((1, 1), bool), logits[:1], logits[:1] > 0, True)
    np.testing.assert_allclose(alone, 0.0, atol=1e-12)


def test_where_parts_stand_in_a_row_one_in_it_is_likelier_and_one_beside_it_is_not():
    logits = np.array([3.0, 3.0, 0.0, 3.0, 3.0, 3.0, 0.0])
    told = arrangement_evidence(chain(7, 6), logits, logits > 1, True)
    assert told[2] > 1.5 and told[6] < -0.5
    few = arrangement_evidence(chain(7, 3), logits, logits > 1, True)
    assert 0.5 < few[2] < told[2]  # in a frame of which less stands in rows it tells less
    assert told[6] < few[6] < 0.0


def test_an_unlikely_neighbour_vouches_for_nothing_and_none_for_itself():
    logits = np.array([2.0, 2.0, 2.0, -6.0])
    wrong = chain(4, 0)
    wrong[2, 3] = wrong[3, 2] = True
    told = arrangement_evidence(wrong, logits, logits > 0, True)
    np.testing.assert_allclose(told, 0.0, atol=0.1)
    pair = arrangement_evidence(chain(2, 2), np.array([2.0, 2.0]), np.array([True, True]), True)
    one = arrangement_evidence(chain(2, 2), np.array([2.0, -1.0]), np.array([True, False]), True)
    assert pair[0] > one[0] and pair[0] == pytest.approx(pair[1])


def test_where_the_number_is_not_known_only_what_is_likely_by_itself_vouches():
    logits = np.array([4.0, 0.5, 3.0, 3.0, 3.0])
    sure = logits > 1.0
    beside = chain(5, 5)
    known, unknown = (arrangement_evidence(beside, logits, sure, told) for told in (True, False))
    assert known[1] > unknown[1] > 0.5
    two = chain(5, 2)  # as two wrong ones may
    two_logits = np.array([0.1, 0.1, 3.0, 3.0, 3.0])
    assert np.abs(arrangement_evidence(two, two_logits, sure, False)[:2]).max() < 0.1


def test_the_ratio_is_that_of_its_definition():
    """One round by hand: three answers, the first two side by side, all of them sure."""
    right = np.array([0.8, 0.6, 0.5])
    logits = np.log(right / (1.0 - right))
    sure = np.ones(3, dtype=bool)
    for _ in range(2):
        near = np.array([right[1], right[0], 0.0])
        expected = []
        for k in range(3):
            others = [j for j in range(3) if j != k]
            share = sum(right[j] * near[j] for j in others) + 0.05
            share = max(share / (sum(right[j] for j in others) + 1.0), 0.05)
            if_right = near[k] * share + (1.0 - near[k]) * (1.0 - share)
            if_wrong = near[k] * 0.05 + (1.0 - near[k]) * 0.95
            expected.append(np.log(if_right / if_wrong))
        right = 1.0 / (1.0 + np.exp(-logits - expected))
    np.testing.assert_allclose(arrangement_evidence(chain(3, 2), logits, sure, True), expected)


def test_answers_in_the_colours_of_many_others_are_likelier_and_others_less():
    """9 for each unit of the Bhattacharyya coefficient from .88 on, from -3 to 1."""
    rng = np.random.default_rng(2)
    usual, other = rng.dirichlet(np.full(864, 0.02), 2)
    shares = np.stack(
        [usual, 0.9 * usual + 0.1 * other, usual, usual, other, 0.7 * usual + 0.3 * other]
    )
    logits = np.array([3.0, 2.0, 4.0, 3.0, -1.0, 0.0])
    told = likeness_evidence(shares, logits)
    right = 1.0 / (1.0 + np.exp(-logits))
    for n in range(6):
        rest = [m for m in range(6) if m != n]
        part = np.average(shares[rest], axis=0, weights=right[rest])
        alike = np.sqrt(part * shares[n]).sum()
        assert told[n] == pytest.approx(np.clip(9.0 * (alike - 0.88), -3.0, 1.0), abs=1e-9)
    assert told[0] > 0.0 and told[4] == -3.0 and told[4] < told[5] < told[1]


def test_one_other_alone_tells_nothing_of_colours():
    shares = np.eye(864)[[0, 0, 1]]
    assert (likeness_evidence(shares[1:], np.array([9.0, 9.0])) == 0.0).all()
    assert (likeness_evidence(shares[:1], np.array([9.0])) == 0.0).all()
    first, second, other = likeness_evidence(shares, np.array([9.0, 9.0, 9.0]))
    assert first == second and -1.5 <= other < first  # half of what three would tell
    assert likeness_evidence(np.zeros((5, 864)), np.full(5, 9.0)) == pytest.approx(0.0)
