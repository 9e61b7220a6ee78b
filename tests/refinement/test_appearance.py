"""What the look of answers tells of others: parts of a kind look alike, most are plain."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial import cKDTree

from hlp.geometry import inverse, rotation_matrices, transform
from hlp.image_edges import color_edges
from hlp.refinement.appearance import (
    FrameColors,
    _difference_ratios,
    appearance_evidence,
    color_evidence,
    plain_evidence,
    print_evidence,
)
from hlp.refinement.verification import VerificationSettings, Verifier, observe
from hlp.rendering.rasterizer import render_depth
from hlp.rendering.surface import surface_and_normals
from refinement_scene import CAMERA, SHAPE, make_model, posed

YELLOW, RED, BLUE = (210, 190, 40), (180, 40, 40), (30, 60, 170)
PLACES = np.array([[-0.2, 0.0, 0.8], [0.0, 0.05, 0.8], [0.2, 0.0, 0.8]])
MODEL = make_model()
VERIFIER = Verifier(MODEL, VerificationSettings())
TURN = rotation_matrices(np.array([[0.8, 0.3, 0.2, 0.5]]))[0]
POSES = np.stack([posed(MODEL, TURN, place) for place in PLACES])


def looks(rgb, depth, poses):
    """The frame's colours and the appearances at poses in an image with some noise."""
    noise = np.random.default_rng(0).normal(0.0, 6.0, rgb.shape)
    rgb = np.clip(rgb + noise, 0, 255).astype(np.uint8)
    seen = observe(rgb, depth, CAMERA, VERIFIER.settings)
    colors = FrameColors.of(rgb, color_edges(rgb), MODEL, CAMERA[0, 0] * MODEL.diameter / 0.8)
    return colors, [colors.at(VERIFIER, seen, pose) for pose in poses]


@pytest.fixture(scope="module")
def plain():
    """Two yellow things and a red one on blue ground."""
    drawn = render_depth(MODEL.mesh, POSES, CAMERA, SHAPE)
    rgb = np.tile(np.array(BLUE, np.uint8), (*SHAPE, 1))
    for mask, color in zip(drawn > 0, (YELLOW, YELLOW, RED), strict=True):
        rgb[mask] = color
    return looks(rgb, drawn.max(axis=0), POSES)


@pytest.fixture(scope="module")
def printed():
    """Two things with one print, and the second once more, 25 mm off along its length."""
    drawn = render_depth(MODEL.mesh, POSES[:2], CAMERA, SHAPE)
    rgb = np.tile(np.array(BLUE, np.uint8), (*SHAPE, 1))
    for depth, pose in zip(drawn, POSES[:2], strict=True):
        mask = depth > 0
        points, _ = surface_and_normals(depth, mask, int(mask.sum()), CAMERA)
        along = transform(inverse(pose), points)[:, 0] - MODEL.centroid[0]
        colors = np.where((along < -0.02)[:, None], RED, YELLOW)
        rgb[mask] = np.where((along > 0.025)[:, None], (250, 250, 250), colors)
    beside = POSES[1].copy()
    beside[:3, 3] += 0.025 * beside[:3, 0]
    return looks(rgb, drawn.max(axis=0), [*POSES[:2], beside])


def test_no_answer_speaks_for_itself(plain):
    frame, seen = plain
    shares, same = np.stack([answer.shares for answer in seen]), np.eye(3, dtype=bool)
    logits = np.array([2.0, -50.0, -50.0])
    assert color_evidence(shares, logits, same, frame.shares)[0] == pytest.approx(0.0, abs=1e-9)
    assert print_evidence(seen, logits, same, frame.equal)[0] == pytest.approx(0.0)
    both = color_evidence(shares, np.array([2.0, 1.0, -50.0]), same, frame.shares)
    assert (both[:2] > 1.0).all() and both[2] < -1.0


def test_answers_at_one_place_count_as_one(plain):
    frame, seen = plain
    once = appearance_evidence(seen, np.zeros(3), np.zeros(3, bool), frame)
    repeated = [*seen[:1] * 4, *seen[1:]]
    often = appearance_evidence(repeated, np.zeros(6), np.zeros(6, bool), frame)
    assert often[4:] == pytest.approx(once[1:], abs=1e-6)


def test_it_is_the_log_ratio(plain, monkeypatch):
    monkeypatch.setattr("hlp.refinement.appearance._ROUNDS", 1)
    frame, seen = plain
    own, background = np.stack([answer.shares for answer in seen]), frame.shares
    logits = np.array([2.0, 0.5, 1.0])
    weights = 1.0 / (1.0 + np.exp(-logits))
    found = color_evidence(own, logits, np.eye(3, dtype=bool), background)
    for n in range(3):
        others = [m for m in range(3) if m != n]
        part = sum(weights[m] * own[m] for m in others) + 0.3 * background
        part /= sum(weights[m] for m in others) + 0.3
        ratio = np.log(part + 1e-5) - np.log(background + 1e-5)
        assert found[n] == pytest.approx(0.7 * float(own[n] @ ratio))


def test_many_doubtful_ones_that_look_alike_outweigh_a_surer_one(plain):
    frame, seen = plain
    logits = np.array([-1.5, -1.5, -1.0])
    told = appearance_evidence(seen, logits, np.zeros(3, bool), frame)
    first, second, other = logits + told
    assert min(first, second) > other


def test_print_tells_the_place(printed):
    frame, seen = printed
    logits, same = np.array([1.0, 0.0, 0.0]), np.eye(3, dtype=bool)
    first, second, beside = print_evidence(seen, logits, same, frame.equal)
    assert min(first, second) > 0.5 and beside < second - 1.0


def test_print_counts_where_parts_are_printed(printed):
    frame, seen = printed
    logits, sure = np.array([4.0, 4.0, 0.0]), np.array([True, True, False])

    def told(clutter):
        shown = [answer._replace(clutter=clutter) for answer in seen]
        return appearance_evidence(shown, logits, sure, frame)

    assert told(0.5)[1] - told(0.5)[2] > told(0.1)[1] - told(0.1)[2] + 0.5


def test_the_ratio_is_that_of_numpy():
    rng = np.random.default_rng(1)
    colors = rng.normal(0.0, 0.4, (4, 50, 3)).astype(np.float32)
    colors[rng.random((4, 50)) < [[0.3], [0.4], [0.5], [0.97]]] = np.nan
    unlike = rng.uniform(0.1, 0.3, (4, 50)).astype(np.float32)
    equal = np.stack([np.arange(50), rng.permutation(50)])
    shown = np.array([0, 2])
    found = _difference_ratios(colors, unlike, shown, equal, 0.36, 0.12, 0.02, 0.4)
    for s, n in np.ndindex(found.shape):
        squared = np.square(colors[n] - colors[shown[s]][equal]).sum(axis=-1)
        both = np.isfinite(squared)
        total = np.where(both, np.minimum(squared, 0.36) + 0.4 * 0.02, 0.0).sum(axis=1)
        expected = np.where(both, unlike[n] + 0.02, 1e-12).sum(axis=1)
        ratios = (total / expected)[both.mean(axis=1) >= 0.12]
        least = ratios.min() if len(ratios) else np.nan
        assert found[s, n] == pytest.approx(least, rel=1e-4, nan_ok=True)
    assert np.isnan(found[:, 3]).all() and np.isfinite(found[:, :3]).all()


def test_symmetries_lead_to_samples_of_the_same_place():
    turn = np.diag([-1.0, -1.0, 1.0, 1.0])
    turn[:3, 3] = MODEL.centroid - turn[:3, :3] @ MODEL.centroid
    symmetric = replace(MODEL, symmetries=np.stack([np.eye(4), turn]))
    black = np.zeros((*SHAPE, 3), np.uint8)
    frame = FrameColors.of(black, color_edges(black), symmetric, 100.0)
    assert (frame.equal[0] == np.arange(len(frame.samples))).all()
    _, nearest = cKDTree(frame.samples).query(transform(turn, frame.samples))
    assert (frame.equal[1] == nearest).all()


def test_what_is_outside_the_image_is_not_seen():
    pose = posed(MODEL, TURN, np.array([-0.23, 0.0, 0.8]))
    drawn = render_depth(MODEL.mesh, pose[None], CAMERA, SHAPE)[0]
    rgb = np.tile(np.array(YELLOW, np.uint8), (*SHAPE, 1))
    frame, [cut] = looks(rgb, drawn, [pose])
    points = transform(pose, frame.samples)
    outside = CAMERA[0, 0] * points[:, 0] / points[:, 2] + CAMERA[0, 2] < -0.5
    assert 20 < outside.sum() < 200
    assert np.isnan(cut.print[outside]).all() and np.isfinite(cut.print[~outside]).any()


def test_where_nothing_agrees_nothing_is_told():
    rgb, depth = np.zeros((*SHAPE, 3), np.uint8), np.full(SHAPE, 2.0, np.float32)
    frame, [none] = looks(rgb, depth, POSES[1:2])
    assert not none.shares.any() and np.isnan(none.print).all() and np.isnan(none.clutter)
    told = appearance_evidence([none] * 2, np.zeros(2), np.zeros(2, bool), frame)
    assert told == pytest.approx(0.0)


@pytest.mark.parametrize(("print_width", "least", "most"), [(0, 0.0, 0.02), (6, 0.3, 1.0)])
def test_clutter_is_edges_that_the_model_lacks(print_width, least, most):
    drawn = render_depth(MODEL.mesh, POSES[1:2], CAMERA, SHAPE)[0]
    rgb = np.tile(np.array(BLUE, np.uint8), (*SHAPE, 1))
    rgb[drawn > 0] = YELLOW
    if print_width:
        rgb[(drawn > 0) & (np.arange(SHAPE[1]) // print_width % 2 > 0)] = RED
    seen = observe(rgb, drawn, CAMERA, VERIFIER.settings)
    found = FrameColors.of(rgb, color_edges(rgb), MODEL, 100.0).at(VERIFIER, seen, POSES[1])
    assert least <= found.clutter <= most


def test_plain_answers_gain_and_cluttered_ones_lose():
    logits, nobody = np.zeros(3), np.zeros(3, bool)
    (plain, between, cluttered), _ = plain_evidence(np.array([0.1, 0.25, 0.7]), logits, nobody)
    assert plain > 1.0 and between == pytest.approx(0.0) and cluttered < -1.0


def test_sure_answers_tell_that_the_parts_are_printed():
    clutter, sure = np.full(5, 0.7), np.array([True] * 4 + [False])

    def told(clutter, logit, sure):
        evidence, printed = plain_evidence(clutter, np.full(5, logit), sure)
        return evidence[4], printed

    alone, prior = told(clutter, 0.0, np.zeros(5, bool))
    printed, probable = told(clutter, 4.0, sure)
    doubtful, between = told(clutter, 0.5, sure)
    assert alone < doubtful < printed and -1.0 < printed < -0.7  # edges are dense
    assert prior == pytest.approx(0.2) and prior < between < probable
    plain, improbable = told(np.array([0.1, 0.1, 0.1, 0.1, 0.7]), 4.0, sure)
    assert plain < alone and improbable < 0.05
