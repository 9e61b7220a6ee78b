"""The order in which a robot would pick what was found, on exact scenes."""

from itertools import combinations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from hlp.data.synthetic.bins import BinScenes, BinSettings, bin_parts
from hlp.data.synthetic.objects import shape_model
from hlp.geometry import rigid
from hlp.method.find.detections import Detection, with_ranks
from hlp.objects.shapes import CUBE, hull_mesh
from hlp.records import Frame, Target
from hlp.refinement.pose_fit import PoseFit
from hlp.rendering.rasterizer import render_depth

CAMERA = np.array([[500.0, 0, 320.0], [0, 500.0, 240.0], [0, 0, 1.0]])
PLATE = shape_model(1, "plate", hull_mesh(CUBE * [0.05, 0.015, 0.005], np.full(3, 128, np.uint8)))
FIT = PoseFit(cost=0.1, depth_correlation=0.9, slope=0.9, residual_mm=1.0, visible_fraction=1.0)
FRAME = Frame(0, 0, np.zeros((480, 640, 3), np.uint8), np.zeros((480, 640)), CAMERA)


def found(pose, score=0.9, visible=1.0, name="plate"):
    return Detection(name, score, pose, visible, 0.0, 1.0, pose[None], None, FIT)


def plate(x=0.0, y=0.0, z=0.6, turn=0.0, **values):
    """A plate before a camera that looks straight down on it."""
    about_z = Rotation.from_rotvec([0.0, 0.0, turn]).as_matrix()
    return found(rigid(about_z, np.array([x, y, z])), **values)


def ranks(*answers):
    return [answer.rank for answer in with_ranks(answers, {1: PLATE}, FRAME)]


def test_side_by_side_the_sure_and_visible_come_first():
    apart = (plate(y=y, score=s, visible=v) for y, s, v in [(-0.1, 0.6, 1.0), (0, 0.9, 0.5)])
    assert ranks(*apart, plate(y=0.1, score=0.8, visible=0.9)) == [1, 2, 0]
    assert ranks() == []
    assert ranks(plate()) == [0] and plate().rank is None


def test_what_lies_on_others_comes_before_them_however_unsure_it_is():
    lowest, middle = plate(score=0.95, visible=0.9), plate(z=0.59, turn=0.5, score=0.9)
    top = plate(z=0.58, turn=1.5, score=0.5, visible=0.8)
    assert ranks(lowest, middle, top) == [2, 1, 0]
    assert ranks(lowest, top, middle) == [2, 0, 1]
    beside = plate(x=0.15, score=0.7)
    assert ranks(lowest, middle, top, beside) == [3, 2, 1, 0]


def test_a_common_border_is_no_overlap():
    assert ranks(plate(score=0.9), plate(y=0.0299, z=0.55, score=0.6)) == [0, 1]
    assert ranks(plate(score=0.9), plate(y=0.02, z=0.55, score=0.6)) == [1, 0]


def test_three_that_lie_on_each_other_in_a_circle_begin_with_the_surest():
    """Each end lies on the next one's start, as the lid of a box is folded."""
    answers = []
    for number, score in enumerate((0.6, 0.9, 0.7)):
        around = plate(turn=2 * np.pi / 3 * number).pose_cam_obj[:3, :3]
        leaning = Rotation.from_rotvec([0.0, np.arcsin(0.1), 0.0]).as_matrix()
        place = around @ np.array([0.0, -0.02, 0.0]) + [0.0, 0.0, 0.6]
        answers.append(found(rigid(around @ leaning, place), score))
    assert sorted(ranks(*answers)) == [0, 1, 2]
    assert ranks(*answers)[1] == 0
    assert ranks(answers[0], answers[2]) in ([0, 1], [1, 0])


@pytest.mark.parametrize("number", [1, 2])
def test_nothing_in_a_bin_is_picked_from_below_another(number):
    scenes = BinScenes(BinSettings(scenes=3, noise=0.0, objects=(7, 8)))
    frame = scenes.load(scenes.keys[number])
    models, rng = bin_parts(), np.random.default_rng(0)

    def answer(target: Target) -> Detection:
        name = models[target.object_id].name
        return found(target.pose_cam_obj, rng.uniform(0.5, 1.0), target.visible_fraction, name)

    answers = with_ranks([answer(target) for target in frame.targets], models, frame)
    assert sorted(one.rank for one in answers) == list(range(len(frame.targets)))
    in_turn = sorted(answers, key=lambda one: one.rank)
    drawn = []
    for one in in_turn:
        (model,) = (model for model in models.values() if model.name == one.object)
        camera, poses = frame.camera_matrix, one.pose_cam_obj[None]
        drawn.append(render_depth(model.mesh, poses, camera, (480, 640))[0])
    hidden = 0
    for first, later in combinations(drawn, 2):
        both = (first > 0) & (later > 0)
        if both.sum() > 0.05 * min((first > 0).sum(), (later > 0).sum()):
            assert np.median((first - later)[both]) < 0
            hidden += 1
    assert hidden >= 2
