"""What the look of sure answers tells of others: parts of a kind look alike, most are plain."""

import numpy as np
import pytest

from hlp.geometry import rigid
from hlp.refinement.appearance import FrameColors, color_evidence, plain_evidence
from hlp.refinement.verification import VerificationSettings, Verifier, observe
from hlp.rendering.rasterizer import render_depth
from refinement_scene import CAMERA, SHAPE, make_model

YELLOW, RED, BLUE = (210, 190, 40), (180, 40, 40), (30, 60, 170)
PLACES = np.array([[-0.2, 0.0, 0.8], [0.0, 0.05, 0.8], [0.2, 0.0, 0.8]])


@pytest.fixture(scope="module")
def shares():
    """Shares of colours of the frame, and of two yellow things and a red one on blue ground."""
    model = make_model()
    poses = np.stack([rigid(np.eye(3), place - model.centroid) for place in PLACES])
    drawn = render_depth(model.mesh, poses, CAMERA, SHAPE)
    rgb = np.tile(np.array(BLUE, np.uint8), (*SHAPE, 1))
    for mask, color in zip(drawn > 0, (YELLOW, YELLOW, RED), strict=True):
        rgb[mask] = color
    noise = np.random.default_rng(0).normal(0.0, 6.0, rgb.shape)
    rgb = np.clip(rgb + noise, 0, 255).astype(np.uint8)
    settings = VerificationSettings()
    verifier = Verifier(model, settings)
    seen = observe(rgb, drawn.max(axis=0), CAMERA, settings)
    colors = FrameColors.of(rgb)
    return colors.shares, np.stack([colors.at(verifier, seen, pose).shares for pose in poses])


def test_no_answer_speaks_for_itself(shares):
    background, own = shares
    alone = color_evidence(own, np.array([0.9, 0.0, 0.0]), background)[0]
    assert alone == pytest.approx(0.0, abs=1e-9)
    both = color_evidence(own, np.array([0.9, 0.8, 0.0]), background)
    assert (both[:2] > 1.0).all()


def test_it_is_the_log_ratio(shares):
    background, own = shares
    weights = np.array([0.9, 0.6, 0.7])
    for n, found in enumerate(color_evidence(own, weights, background)):
        others = [m for m in range(3) if m != n]
        part = sum(weights[m] * own[m] for m in others) + 0.3 * background
        part /= sum(weights[m] for m in others) + 0.3
        ratio = np.log(part + 1e-5) - np.log(background + 1e-5)
        assert found == pytest.approx(0.7 * float(own[n] @ ratio))


def test_where_nothing_agrees_there_are_no_colours(shares):
    model, rgb = make_model(), np.zeros((*SHAPE, 3), np.uint8)
    settings = VerificationSettings()
    seen = observe(rgb, np.full(SHAPE, 2.0, np.float32), CAMERA, settings)
    pose = rigid(np.eye(3), PLACES[1] - model.centroid)
    none = FrameColors.of(rgb).at(Verifier(model, settings), seen, pose)
    assert not none.shares.any() and np.isnan(none.clutter)
    assert color_evidence(none.shares[None], np.zeros(1), shares[0]) == pytest.approx(0.0)
    told = plain_evidence(np.array([none.clutter]), np.zeros(1), np.zeros(1, bool))
    assert told == pytest.approx(0.0)


@pytest.mark.parametrize(("print_width", "least", "most"), [(0, 0.0, 0.02), (6, 0.3, 1.0)])
def test_clutter_is_edges_that_the_model_lacks(print_width, least, most):
    model, settings = make_model(), VerificationSettings()
    pose = rigid(np.eye(3), PLACES[1] - model.centroid)
    drawn = render_depth(model.mesh, pose[None], CAMERA, SHAPE)[0]
    rgb = np.tile(np.array(BLUE, np.uint8), (*SHAPE, 1))
    rgb[drawn > 0] = YELLOW
    if print_width:
        rgb[(drawn > 0) & (np.arange(SHAPE[1]) // print_width % 2 > 0)] = RED
    seen = observe(rgb, drawn, CAMERA, settings)
    assert least <= FrameColors.of(rgb).at(Verifier(model, settings), seen, pose).clutter <= most


def test_plain_answers_gain_and_cluttered_ones_lose():
    logits, nobody = np.zeros(3), np.zeros(3, bool)
    plain, between, cluttered = plain_evidence(np.array([0.1, 0.25, 0.7]), logits, nobody)
    assert plain > 1.0 and between == pytest.approx(0.0) and cluttered < -1.0


def test_sure_answers_tell_that_the_parts_are_printed():
    clutter, sure = np.full(5, 0.7), np.array([True] * 4 + [False])
    alone = plain_evidence(clutter, np.zeros(5), np.zeros(5, bool))[4]
    printed = plain_evidence(clutter, np.full(5, 4.0), sure)[4]
    doubtful = plain_evidence(clutter, np.full(5, 0.5), sure)[4]
    assert alone < doubtful < printed and -1.0 < printed < -0.7  # edges are dense
    plain = plain_evidence(np.array([0.1, 0.1, 0.1, 0.1, 0.7]), np.full(5, 4.0), sure)[4]
    assert plain < alone
