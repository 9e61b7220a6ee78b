"""The score's logistic regression on poses whose truth is known."""

from dataclasses import replace
from functools import partial
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.optimize import minimize
from scipy.special import logit

from hlp.errors import DataError, MissingFileError
from hlp.refinement.pose_fit import PoseFit
from hlp.refinement.score_model import (
    COLORLESS_PRIOR,
    PRIOR,
    SPREAD,
    ScoreModel,
    dullness_evidence,
    fit_score_model,
    load_score_model,
    save_score_model,
)
from hlp.stages.training import TrainingStages

OPTIONS = {"xatol": 1e-7, "fatol": 1e-10, "maxiter": 9999, "maxfev": 9999, "adaptive": True}


def fits_of(costs, shapes):
    """Fits whose correlations of depth and slope have the given mean Fisher transform."""
    return [
        PoseFit(float(c), float(np.tanh(z - 0.1)), float(np.tanh(z + 0.1)), 2.0, 1.0)
        for c, z in zip(costs, shapes, strict=True)
    ]


def drawn(count, truth, seed):
    rng = np.random.default_rng(seed)
    fits = fits_of(rng.uniform(0.1, 0.4, count), rng.uniform(0.2, 2.5, count))
    chance = np.array([truth.score(fit) for fit in fits])
    return fits, rng.random(count) < chance


def test_an_object_of_which_little_is_seen_is_not_found_unless_it_is_known_to_be_there():
    full = PoseFit(0.05, 0.99, 0.99, 1.0, 1.0)
    scores = [PRIOR.score(replace(full, visible_fraction=v)) for v in (0.0, 0.15, 0.29, 0.31)]
    assert scores[:2] == [0.0, 0.25]
    assert scores[2] < 0.5 < scores[3] == PRIOR.score(full)
    hidden = replace(full, visible_fraction=0.15)
    assert known_score(PRIOR, hidden) == known_score(PRIOR, full)
    assert 0.9 < known_score(COLORLESS_PRIOR, hidden) < known_score(COLORLESS_PRIOR, full)


def known_score(model, fit):
    (score,) = model.scores([fit], known_present=True)
    return score


def test_of_several_without_colours_one_that_fits_worse_than_the_surest_is_less_likely_right():
    """Beside its own logit: 30 and 15 for cost and edge, beyond .05 more than those of others.

    What is hidden is no part of the cost; others that cost .05 more count e times less.
    """
    looks = [
        (0.1, 0.02, 0.6, 0.9),
        (0.12, 0.05, 0.4, 1),
        (0.22, 0.03, 0.5, 1),
        (0.11, 0.14, 0.5, 1),
    ]
    fits = [PoseFit(cost, z, z, 1.0, seen, edge=edge) for cost, edge, z, seen in looks]
    alone = np.array([known_score(COLORLESS_PRIOR, fit) for fit in fits])
    np.testing.assert_allclose(
        logit(alone), logit([COLORLESS_PRIOR.score(fit) for fit in fits]) + np.log(9.0 / 1.5)
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
    told = COLORLESS_PRIOR.scores(fits, known_present=True)
    np.testing.assert_allclose(logit(told), expected)
    assert told[2] < alone[2] and told[3] < alone[3] and told[0] == pytest.approx(alone[0])
    unsure = [replace(fit, edge=fit.edge + 0.5) for fit in fits[1:3]]
    assert known_scores(unsure) == [known_score(COLORLESS_PRIOR, fit) for fit in unsure]
    assert COLORLESS_PRIOR.scores(fits) == [COLORLESS_PRIOR.score(fit) for fit in fits]
    colored = [known_score(PRIOR, fit) for fit in fits]
    assert PRIOR.scores(fits, known_present=True) == colored
    assert PRIOR.scores([], known_present=True) == known_scores([]) == []


def test_where_the_surest_do_not_fit_well_all_are_likelier():
    """By what cost and edge take from their logits beyond 2.2: the image is not exact."""
    fits = [PoseFit(0.2, z, z, 1.0, 1.0, edge=0.15) for z in (0.95, 0.9, 0.8)]
    alone = [known_score(COLORLESS_PRIOR, fit) for fit in fits]
    forgiven = 8.0 * 0.2 + 13.0 * 0.15 - 2.2
    np.testing.assert_allclose(logit(known_scores(fits)), logit(alone) + forgiven)
    worst = [replace(fit, cost=0.4, edge=0.25, plane_deviation_mm=90.0) for fit in fits]
    worst = [replace(fit, depth_correlation=0.99, slope=0.99) for fit in worst]
    alone = [known_score(COLORLESS_PRIOR, fit) for fit in worst]
    np.testing.assert_allclose(logit(known_scores(worst)), logit(alone) + 2.5)
    exact = [replace(fit, cost=0.1, edge=0.05) for fit in fits]
    assert known_scores(exact) == [known_score(COLORLESS_PRIOR, fit) for fit in exact]


def known_scores(fits):
    return COLORLESS_PRIOR.scores(fits, known_present=True)


def test_weights_are_the_minimum_of_the_penalised_likelihood():
    fits, right = drawn(40, ScoreModel(5.0, -30.0, 1.0), 1)
    rng = np.random.default_rng(6)
    fits = [
        replace(fit, edge=rng.uniform(0.0, 0.4), visible_fraction=rng.uniform(0.5, 1.0))
        for fit in fits
    ]
    shapes = [(np.arctanh(f.depth_correlation) + np.arctanh(f.slope)) / 2.0 for f in fits]
    others = [[1.0, fit.cost, fit.edge, 1.0 - fit.visible_fraction] for fit in fits]
    x = np.insert(np.array(others), 2, shapes, axis=1)
    weight = np.where(right, 0.6 / right.mean(), 0.4 / (~right).mean())
    prior = COLORLESS_PRIOR.weights()

    def loss(w):
        p = 1.0 / (1.0 + np.exp(-x @ w))
        likelihood = (weight * np.log(np.where(right, p, 1.0 - p))).sum()
        return float(-likelihood + 0.5 * np.square((w - prior) / SPREAD.weights()).sum())

    expected = minimize(loss, prior, method="Nelder-Mead", options=OPTIONS)
    found = fit_score_model(fits, right)
    np.testing.assert_allclose(found.weights(), expected.x, rtol=2e-3)
    spread = ScoreModel(0.5, 3.0, 0.3)
    fixed = fit_score_model(fits, right, PRIOR, spread)  # a weight without a spread stays
    assert fixed.edge == PRIOR.edge and fixed.hidden == PRIOR.hidden


def test_a_better_fit_never_has_a_lower_score():
    """Also where the poses say the contrary."""
    rng = np.random.default_rng(2)
    costs = rng.uniform(0.1, 0.4, 2000)
    found = fit_score_model(fits_of(costs, rng.uniform(0.2, 2.0, 2000)), costs > 0.25)
    assert found.cost == 0.0 and found.shape >= 0.0
    good, less, opposite, no_better = (
        PRIOR.score(PoseFit(*measured, 1.0, 1.0))
        for measured in ((0.1, 0.9, 0.9), (0.2, 0.9, 0.9), (0.2, 1.0, -1.0), (0.2, 0.9, -1.0))
    )
    assert good > less and opposite >= no_better


def test_poses_of_one_kind_teach_nothing():
    fits, _ = drawn(10, PRIOR, 3)
    assert fit_score_model(fits, np.zeros(10, dtype=bool)) == COLORLESS_PRIOR
    assert fit_score_model([], np.zeros(0, dtype=bool)) == COLORLESS_PRIOR


def test_weights_come_back_from_a_file_and_a_damaged_one_is_named(tmp_path):
    model = ScoreModel(1.5, -12.25, 0.125, -3.5, -0.25)
    save_score_model(tmp_path, model)
    assert load_score_model(tmp_path) == model
    path = tmp_path / "score.json"
    path.write_text('{"bias": 1, "cost": null, "shape": 2, "edge": 0, "hidden": 0}')
    with pytest.raises(
        DataError, match=r"score\.json: cost is null: it must be a number: learn the object again"
    ):
        load_score_model(tmp_path)
    path.unlink()
    with pytest.raises(MissingFileError, match=r"score\.json: learn the object"):
        load_score_model(tmp_path)


def test_colours_that_contradict_lower_the_score_of_colourful_objects_alone():
    def score(color, contrast):
        return PRIOR.score(PoseFit(0.15, 0.9, 0.9, 1.0, 1.0, color, contrast))

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
        return PRIOR.score(PoseFit(0.15, shape, shape, 1.0, 1.0, plane_deviation_mm=deviation_mm))

    assert score(0.0, 0.0) == pytest.approx(score(0.99, 0.0))
    assert score(0.3, 50.0) < score(0.3, 1.0) < score(0.97, 1.0) < score(0.97, 50.0)


def test_an_object_that_the_image_cuts_off_is_less_likely_right_known_to_be_there_or_not():
    whole = PoseFit(0.15, 0.9, 0.9, 1.0, 0.6)
    cut_off = replace(whole, inside_fraction=0.6)
    for score in (PRIOR.score, partial(known_score, PRIOR)):
        away = logit(score(whole)) - logit(score(cut_off))
        assert away == pytest.approx(10.0 * 0.4**2)


def falls_by(**changes):
    """By how much the logit of a fit falls for each value of one of its fields."""
    fit = PoseFit(0.15, 0.9, 0.9, 1.0, 1.0)
    ((name, values),) = changes.items()
    found = [logit(COLORLESS_PRIOR.score(replace(fit, **{name: value}))) for value in values]
    return logit(COLORLESS_PRIOR.score(fit)) - np.array(found)


def test_a_narrow_side_is_less_likely_right():
    assert falls_by(projected_share=(1.0, 0.8, 0.5, 0.25)) == pytest.approx([0.0, 1.6, 4.0, 6.0])


def test_a_pose_with_which_few_pixels_agree_is_less_likely_right():
    few = falls_by(pixels=(np.inf, 2000.0, 1000.0, 500.0, 0.0))
    assert few == pytest.approx([0.0, 0.0, np.log(2), np.log(4), np.log(2000)])


def test_colours_and_the_border_are_no_part_of_the_fit():
    fits, right = drawn(400, ScoreModel(2.0, -20.0, 2.2), 5)
    told = [replace(fit, color=0.0, contrast=0.5, inside_fraction=0.5) for fit in fits]
    assert fit_score_model(told, right) == fit_score_model(fits, right)


def test_colours_do_not_count_for_an_object_that_is_known_to_be_there():
    contradicting, agreeing = (PoseFit(0.2, 0.8, 0.8, 1.0, 1.0, c, 0.8) for c in (0.0, 1.0))
    told = [known_score(PRIOR, fit) for fit in (contradicting, agreeing)]
    assert told[0] == told[1] > PRIOR.score(agreeing)


def test_objects_with_colours_and_all_without_scenes_have_the_score_of_any_object():
    meshes = {1: SimpleNamespace(colored=True), 2: SimpleNamespace(colored=False)}
    models = {i: SimpleNamespace(mesh=mesh) for i, mesh in meshes.items()}
    stages = SimpleNamespace(settings=SimpleNamespace(score=SimpleNamespace()), models=models)
    stages.has_own_score = own = partial(TrainingStages.has_own_score, stages)
    for stages.settings.score.scenes, expected in ((36, [False, True]), (0, [False, False])):
        assert [own(i) for i in models] == expected
    assert [TrainingStages.load_score_model(stages, i) for i in models] == [PRIOR, COLORLESS_PRIOR]
