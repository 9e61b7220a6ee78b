"""How well poses fit a frame, each measured once; packed parts do not speak against each other."""

from dataclasses import replace
from types import SimpleNamespace
from unittest.mock import Mock

import numpy as np
import pytest
import trimesh

from hlp.geometry import rigid
from hlp.method.find import frame_fits
from hlp.method.find.frame_fits import FrameFits
from hlp.refinement.pose_fit import PoseFit
from hlp.refinement.score_model import COLORED, COLORLESS
from hlp.rendering.rasterizer import render_depth
from packed_boxes import WHITE, box, frame
from refinement_scene import CAMERA, SHAPE

AWAY = trimesh.transformations.rotation_matrix(0.35, [0, 1, 0])[:3, :3]
SIDE = AWAY @ np.array([0.06, 0.0, 0.0])
PACKED = rigid(AWAY, np.array([0.0, 0.0, 0.7]) + np.array([0.0, 1.0])[:, None] * SIDE)
"""Two boxes side by side: the second hides a side of the first."""


@pytest.fixture
def fits():
    verifier = box()
    seen = frame(verifier, WHITE, WHITE, poses=PACKED).observation
    return FrameFits(seen, lambda _: verifier, lambda _: COLORLESS), verifier, seen


def test_a_pose_is_measured_once(fits, monkeypatch):
    own, *_ = fits
    measured = Mock(side_effect=lambda *_: SimpleNamespace())
    monkeypatch.setattr(frame_fits, "measure_fit", measured)
    first = own.measure(1, PACKED[0])
    assert own.measure(1, PACKED[0]) is first is not own.measure(1, PACKED[1])
    assert own.measure(2, PACKED[0]) is not first and measured.call_count == 3


def test_what_a_neighbour_hides_does_not_speak_against_a_part(fits):
    own, *_ = fits
    own.set_appearance(1, PACKED[0], 0.7)
    before, score = own.measure(1, PACKED[0]), own.score(1, PACKED[0])
    own.settle([(1, PACKED[0]), (1, PACKED[1])])
    after = own.measure(1, PACKED[0])
    assert before.plane_deviation_mm > 3.0 and after.plane_deviation_mm < 0.5  # a face is left
    assert after.cost < 0.8 * before.cost
    assert own.score(1, PACKED[0]) > score
    assert (after.appearance, after.visible_fraction) == (0.7, before.visible_fraction)


@pytest.mark.parametrize(("colored", "told"), [(True, -1.5), (False, 0.0)])
def test_only_dull_objects_with_colours_are_doubted(colored, told, monkeypatch):
    fit = PoseFit(0.1, 0.9, 0.9, 1.0, 1.0, contrast=0.2, edge=0.45)
    monkeypatch.setattr(frame_fits, "measure_fit", lambda *_: fit)
    verifier = SimpleNamespace(model=SimpleNamespace(mesh=SimpleNamespace(colored=colored)))
    own = FrameFits(None, lambda _: verifier, lambda _: COLORED)
    own.doubt(1, [np.eye(4)])
    assert own.measure(1, np.eye(4)).appearance == pytest.approx(told)


def test_chosen_ones_have_their_settled_appearance_in_the_end(fits):
    own, *_ = fits
    for pose in PACKED:
        own.set_appearance(1, pose, 0.7)
        own.set_settled(1, pose, 0.2)
    own.settle([(1, PACKED[0])])
    assert [own.measure(1, pose).appearance for pose in PACKED] == [0.2, 0.7]


def test_whose_pixels_surer_ones_explain_better_is_less_likely_right(fits):
    own, verifier, seen = fits
    between = rigid(AWAY, np.array([0.0, 0.0, 0.708]) + 0.5 * SIDE)
    instances = [(1, between), (1, PACKED[0]), (1, PACKED[1])]
    own.settle(instances)  # where scores are to be learnt, nobody is surer
    assert [own.measure(*one).appearance for one in instances] == [0.0, 0.0, 0.0]
    scores = [own.score(*one) for one in instances]
    for one in instances:
        own.set_settled(*one, 0.0)
    assert scores[0] < min(scores[1:])
    drawn = render_depth(verifier.mesh, np.stack([pose for _, pose in instances]), CAMERA, SHAPE)
    off = np.abs(np.where(drawn > 0.0, drawn, np.inf) - seen.depth)
    better = (off[1:] < off[0]).any(axis=0)
    share = better[off[0] <= verifier.tau_depth].mean()
    own.settle(instances)
    after = [own.measure(*one).appearance for one in instances]
    assert share > 0.5 and after[1:] == [0.0, 0.0]
    assert after[0] == pytest.approx(-10.0 * (share - 0.2), abs=0.05)


def test_a_score_by_the_fit_alone_knows_no_appearance(fits):
    own, *_ = fits
    before = own.score(1, PACKED[0])
    own.set_appearance(1, PACKED[0], -2.0)
    assert own.score(1, PACKED[0]) < own.score_alone(1, PACKED[0]) == before


def test_alone_in_front_or_with_colours_a_fit_stays(fits):
    own, verifier, seen = fits
    before, front = (own.measure(1, pose) for pose in PACKED)
    own.settle([(1, PACKED[0])])
    own.settle([])
    assert own.measure(1, PACKED[0]) is before
    own.settle([(1, PACKED[0]), (1, PACKED[1])])
    assert own.measure(1, PACKED[1]) is front
    colored = replace(verifier.model, mesh=replace(verifier.model.mesh, colored=True))
    painted = SimpleNamespace(model=colored, depth_of=verifier.depth_of)
    kinds = {1: verifier, 2: painted}
    both = FrameFits(seen, kinds.__getitem__, lambda _: COLORLESS)
    both._known[2, PACKED[1].tobytes()] = before
    both.settle([(1, PACKED[0]), (2, PACKED[1])])
    assert both.measure(2, PACKED[1]) is before
