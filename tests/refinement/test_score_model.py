"""The score of a pose by its fit."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from scipy.special import logit

from hlp.refinement.pose_fit import PoseFit
from hlp.refinement.score_model import COLORED, COLORLESS, dullness_evidence, score_model_of


def test_an_object_of_which_little_is_seen_is_not_found_unless_it_is_known_to_be_there():
    full = PoseFit(0.05, 0.99, 0.99, 1.0, 1.0)
    scores = [COLORED.score(replace(full, visible_fraction=v)) for v in (0.0, 0.15, 0.29, 0.31)]
    assert scores[:2] == [0.0, 0.25]
    assert scores[2] < 0.5 < scores[3] == COLORED.score(full)
    hidden = replace(full, visible_fraction=0.15)
    assert known_score(COLORED, hidden) == known_score(COLORED, full)
    assert 0.9 < known_score(COLORLESS, hidden) < known_score(COLORLESS, full)


def known_score(model, fit):
    return model.scores([fit], known_present=True)[0]


def test_of_several_without_colours_one_that_fits_worse_than_the_surest_is_less_likely_right():
    """Beside its own logit: 30 and 15 for cost and edge, beyond .05 more than those of others.

    What is hidden is no part of the cost; others that cost .05 more count e times less.
    """
    looks = [
        (0.1, 0.02, 0.6, 0.9),
        (0.12, 0.03, 0.4, 1),
        (0.22, 0.02, 0.5, 1),
        (0.11, 0.12, 0.5, 1),
    ]
    fits = [PoseFit(cost, z, z, 1.0, seen, edge=edge) for cost, edge, z, seen in looks]
    alone = np.array([known_score(COLORLESS, fit) for fit in fits])
    np.testing.assert_allclose(
        logit(alone), logit([COLORLESS.score(fit) for fit in fits]) + np.log(9.0 / 1.5)
    )
    costs = [cost - 0.15 * (1.0 - seen) for cost, _, _, seen in looks]
    expected = []
    for own, (_, edge, *_) in enumerate(looks):
        others = [i for i in range(len(looks)) if i != own]
        weights = [alone[i] ** 2 * np.exp(-costs[i] / 0.05) for i in others]
        cost_beyond = costs[own] - np.average([costs[i] for i in others], weights=weights)
        edge_beyond = edge - np.average([looks[i][1] for i in others], weights=weights)
        worse = 30.0 * max(cost_beyond - 0.05, 0.0) + 15.0 * max(edge_beyond - 0.05, 0.0)
        expected.append(logit(alone[own]) - worse)
    told = COLORLESS.scores(fits, known_present=True)
    np.testing.assert_allclose(logit(told), expected)
    assert told[2] < alone[2] and told[3] < alone[3] and told[0] == pytest.approx(alone[0])
    unsure = [replace(fit, edge=fit.edge + 0.5) for fit in fits[1:3]]
    assert known_scores(unsure) == [known_score(COLORLESS, fit) for fit in unsure]
    assert COLORLESS.scores(fits) == [COLORLESS.score(fit) for fit in fits]
    colored = [known_score(COLORED, fit) for fit in fits]
    assert COLORED.scores(fits, known_present=True) == colored
    assert COLORED.scores([], known_present=True) == known_scores([]) == []


def test_where_the_surest_do_not_fit_well_all_are_likelier():
    """By what cost and edge take from their logits beyond 3: the image is not exact."""
    fits = [PoseFit(0.2, z, z, 1.0, 1.0, edge=0.1) for z in (0.95, 0.9, 0.8)]
    alone = [known_score(COLORLESS, fit) for fit in fits]
    forgiven = 9.5 * 0.2 + 29.0 * 0.1 - 3.0
    np.testing.assert_allclose(logit(known_scores(fits)), logit(alone) + forgiven)
    worst = [replace(fit, cost=0.4, edge=0.25, depth_correlation=0.99, slope=0.99) for fit in fits]
    alone = [known_score(COLORLESS, fit) for fit in worst]
    np.testing.assert_allclose(logit(known_scores(worst)), logit(alone) + 2.5)
    exact = [replace(fit, cost=0.1, edge=0.05) for fit in fits]
    assert known_scores(exact) == [known_score(COLORLESS, fit) for fit in exact]


def known_scores(fits):
    return COLORLESS.scores(fits, known_present=True)


def test_a_better_fit_never_has_a_lower_score():
    good, less, opposite, no_better = (
        COLORED.score(PoseFit(*measured, 1.0, 1.0))
        for measured in ((0.1, 0.9, 0.9), (0.2, 0.9, 0.9), (0.2, 1.0, -1.0), (0.2, 0.9, -1.0))
    )
    assert good > less and opposite >= no_better


def test_colours_that_contradict_lower_the_score_of_colourful_objects_alone():
    def score(color, contrast):
        return COLORED.score(PoseFit(0.15, 0.9, 0.9, 1.0, 1.0, color, contrast))

    assert score(0.6, 0.8) == score(1.0, 0.8) == score(-1.0, 0.0) > 0.9
    assert score(0.2, 0.8) < score(0.5, 0.8) < score(0.6, 0.8)
    assert score(0.2, 0.8) < score(0.2, 0.3) and score(0.2, 0.8) == score(0.2, 2.0)
    away = logit(score(0.4, 0.5)) - logit(score(1.0, 0.5))
    assert away == pytest.approx(-50.0 * 0.2 * 0.25)


def test_missing_edges_tell_the_more_against_an_object_the_less_colour_it_has():
    def told(contrast, edge):
        return dullness_evidence(PoseFit(0.1, 0.9, 0.9, 1.0, 1.0, contrast=contrast, edge=edge))

    assert told(0.0, 0.25) == told(0.4, 0.9) == told(1.0, 0.9) == 0.0
    assert told(0.0, 0.35) == pytest.approx(-1.5) == told(0.1, 0.35) / 0.75


def test_the_shape_of_a_flat_side_says_little():
    def score(shape, deviation_mm):
        return COLORED.score(PoseFit(0.15, shape, shape, 1.0, 1.0, plane_deviation_mm=deviation_mm))

    assert score(0.0, 0.0) == pytest.approx(score(0.99, 0.0))
    assert score(0.3, 50.0) < score(0.3, 1.0) < score(0.97, 1.0) < score(0.97, 50.0)


def test_an_object_that_the_image_cuts_off_is_less_likely_right_known_to_be_there_or_not():
    whole = PoseFit(0.15, 0.9, 0.9, 1.0, 0.6)
    cut_off = replace(whole, inside_fraction=0.6)
    for score in (COLORED.score, partial(known_score, COLORED)):
        away = logit(score(whole)) - logit(score(cut_off))
        assert away == pytest.approx(10.0 * 0.4**2)


def falls_by(**changes):
    """By how much the logit of a fit falls for each value of one of its fields."""
    fit = PoseFit(0.15, 0.9, 0.9, 1.0, 1.0)
    ((name, values),) = changes.items()
    found = [logit(COLORLESS.score(replace(fit, **{name: value}))) for value in values]
    return logit(COLORLESS.score(fit)) - np.array(found)


def test_a_narrow_side_is_less_likely_right_and_less_so_if_one_is_known_to_be_there():
    assert falls_by(projected_share=(1.0, 0.8, 0.5, 0.25)) == pytest.approx([0.0, 1.6, 4.0, 6.0])
    narrow = PoseFit(0.2, 0.8, 0.8, 1.0, 1.0, projected_share=0.5)
    known = logit(known_score(COLORLESS, narrow)) - logit(COLORLESS.score(narrow))
    assert known == pytest.approx(logit(0.9) - logit(0.6) + 2.5)


def test_a_pose_with_which_few_pixels_agree_is_less_likely_right():
    few = falls_by(pixels=(np.inf, 5000.0, 2500.0, 1250.0, 0.0))
    assert few == pytest.approx([0.0, 0.0, np.log(2), np.log(4), np.log(5000)])


def test_colours_do_not_count_for_an_object_that_is_known_to_be_there():
    contradicting, agreeing = (PoseFit(0.2, 0.8, 0.8, 1.0, 1.0, c, 0.8) for c in (0.0, 1.0))
    told = [known_score(COLORED, fit) for fit in (contradicting, agreeing)]
    assert told[0] == told[1] > COLORED.score(agreeing)
    assert [score_model_of(colored).colorless for colored in (False, True)] == [True, False]
