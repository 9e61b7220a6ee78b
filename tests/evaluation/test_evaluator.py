import dataclasses

import numpy as np
import pytest
from boxes import EXTENTS, TRUE, box_model, moved

from hlp.evaluation import EvaluationSettings, errors
from hlp.evaluation.evaluator import FrameTruth, add_correct, score_targets
from hlp.geometry import rigid
from hlp.records import Frame, PoseEstimate, Target
from hlp.rendering.rasterizer import render_depth

K = np.array([[570.0, 0.0, 80.0], [0.0, 570.0, 60.0], [0.0, 0.0, 1.0]])
SETTINGS = EvaluationSettings(symmetric=("cup",))
HALF_TURN = rigid(np.diag([-1.0, -1.0, 1.0]), np.zeros(3))
MODELS = {
    1: box_model(EXTENTS, 1, "cat"),
    2: box_model(EXTENTS, 2, "cup", np.stack([np.eye(4), HALF_TURN])),
}


def _scores(targets, estimates, settings=SETTINGS, meshes=None, frame_id=3):
    """Scores of targets (pose, object) in one frame, given estimates (pose, score, object)."""
    truth = FrameTruth(6, 3, K, 160, tuple(Target(i, pose, 0.7) for pose, i in targets))
    given = [PoseEstimate(6, frame_id, i, pose, score) for pose, score, i in estimates]
    return score_targets([truth], MODELS, given, settings, meshes)


def _one(pose, settings=SETTINGS, object_id=1):
    (score,) = _scores([(TRUE, object_id)], [(pose, 0.5, object_id)], settings)
    return score


def test_the_true_pose_is_right_in_every_respect():
    score = _one(TRUE)
    assert (score.add_correct, score.pose_correct, score.box_correct) == (True, True, True)
    assert (score.scene_id, score.frame_id, score.object_id) == (6, 3, 1)
    assert score.found and score.visible_fraction == 0.7 and score.score == 0.5
    assert score.add_error == 0.0 and score.box_iou == pytest.approx(1.0) and score.add_s_correct
    assert (score.mssd_recall, score.mspd_recall) == (1.0, 1.0)


def test_verdicts_have_their_limits():
    limit = 0.1 * MODELS[1].diameter
    assert [_one(moved(dx=limit * f)).add_correct for f in (0.99, 1.01)] == [True, False]
    for given, right in (
        ({"dz": 0.049}, True),
        ({"dz": 0.051}, False),
        ({"degrees": 4.9}, True),
        ({"degrees": 5.1}, False),
        ({"degrees": 5.1, "dz": 0.049}, False),
    ):
        assert _one(moved(**given)).pose_correct == right, given
    pose = moved(dx=0.02)
    iou = _one(pose).box_iou
    assert 0.3 < iou < 1
    assert _one(pose, dataclasses.replace(SETTINGS, iou=iou)).box_correct
    assert not _one(pose, dataclasses.replace(SETTINGS, iou=iou + 1e-6)).box_correct


@pytest.mark.parametrize(
    ("estimates", "frame_id"), [([], 3), ([(None, 0.5, 1)], 3), ([(TRUE, 0.5, 1)], 4)]
)
def test_a_target_without_a_pose_is_wrong_with_infinite_errors(estimates, frame_id):
    (score,) = _scores([(TRUE, 1)], estimates, frame_id=frame_id)
    assert not score.found and score.visible_fraction == 0.7
    assert (score.add_correct, score.pose_correct, score.box_correct) == (False, False, False)
    infinite = float("inf")
    assert (score.add_error, score.rotation_error, score.translation_error) == (infinite,) * 3
    assert (score.box_iou, score.mssd_recall, score.mspd_recall) == (0.0, 0.0, 0.0)


def test_an_object_that_no_target_asks_for_counts_neither_way():
    assert len(_scores([(TRUE, 1)], [(TRUE, 0.5, 1), (TRUE, 0.5, 2)])) == 1


def test_the_policy_decides_which_objects_are_symmetric():
    by_model = dataclasses.replace(SETTINGS, symmetric=None)
    assert [by_model.is_symmetric(MODELS[i]) for i in (1, 2)] == [False, True]
    for settings in (SETTINGS, by_model):
        symmetric = _one(TRUE @ HALF_TURN, settings, 2)
        assert symmetric.add_correct and symmetric.pose_correct
        assert symmetric.rotation_error == pytest.approx(0, abs=1e-9)
    plain = _one(TRUE @ HALF_TURN, dataclasses.replace(SETTINGS, symmetric=()), 2)
    assert not plain.add_correct and not plain.pose_correct and plain.add_s_correct
    assert plain.rotation_error == pytest.approx(np.pi)
    vertices = MODELS[2].mesh.vertices
    assert plain.add_error == pytest.approx(errors.add(TRUE @ HALF_TURN, TRUE, vertices))


def test_vsd_needs_the_depth_which_is_kept_only_if_asked_for():
    depth = render_depth(MODELS[1].mesh, TRUE[None], K, (120, 160))[0]
    frame = Frame(6, 3, np.zeros((120, 160, 3), np.uint8), depth, K, (Target(1, TRUE),))
    truth, without = FrameTruth.of(frame, with_depth=True), FrameTruth.of(frame)
    assert without.unpacked_depth() is None
    np.testing.assert_array_equal(truth.unpacked_depth(), depth)
    assert (truth.width, truth.targets) == (160, frame.targets)
    recalls = []
    for pose in (TRUE, moved(dx=0.3), None):
        (score,) = score_targets([truth], MODELS, [PoseEstimate(6, 3, 1, pose, 0.5)], SETTINGS)
        recalls.append(score.vsd_recall)
    assert recalls == [1.0, 0.0, 0.0] and np.isnan(_one(TRUE).vsd_recall)


LEFT, RIGHT = moved(dx=-0.05), moved(dx=0.05)
BOTH = [(LEFT, 1), (RIGHT, 1)]


def test_instances_are_matched_once_each_the_surest_estimate_first():
    first, second = _scores(BOTH, [(moved(dx=-0.04), 0.9, 1), (LEFT, 0.3, 1)])
    assert first.translation_error == pytest.approx(0.01)
    assert second.translation_error == pytest.approx(0.10)
    only, lost = _scores(BOTH, [(RIGHT, 0.5, 1)])
    assert not only.found and lost.add_correct


def test_a_wrong_estimate_takes_no_target_from_a_right_one():
    first, second = _scores(BOTH, [(moved(dx=-0.05, dz=0.03), 0.9, 1), (LEFT, 0.3, 1)])
    assert first.add_correct and first.add_error == 0.0 and first.score == 0.3
    assert second.found and not second.add_correct and second.score == 0.9


def test_as_many_estimates_count_as_there_are_targets_the_surest_ones():
    first, second = _scores(BOTH, [(RIGHT, 0.7, 1), (moved(dz=0.4), 0.9, 1), (LEFT, 0.8, 1)])
    assert first.add_correct and not second.add_correct
    assert second.mssd_recall == 0.0
    (score,) = _scores([(TRUE, 1)], [(TRUE, 0.2, 1), (moved(dx=0.3), 0.8, 1)])
    assert not score.add_correct


def test_bops_errors_are_measured_on_another_mesh_if_there_is_one():
    mesh = MODELS[1].mesh
    small = dataclasses.replace(mesh, vertices=mesh.vertices * 0.5)
    own, other = (
        _scores([(TRUE, 1)], [(moved(degrees=35.0), 0.5, 1)], meshes=meshes)[0]
        for meshes in (None, {1: small})
    )
    assert other.mssd_recall > own.mssd_recall and other.add_error == own.add_error


def test_a_target_without_a_model_is_named():
    with pytest.raises(ValueError, match="object 9"):
        _scores([(TRUE, 9)], [])


@pytest.mark.parametrize("object_id", [1, 2])
def test_verdicts_of_many_poses_are_those_of_scoring_them_one_by_one(object_id):
    others = [moved(0.02 * dx, degrees=8.0 * turn) for dx, turn in np.ndindex(4, 4)]
    poses = np.stack([TRUE, TRUE @ HALF_TURN, *others])
    verdicts = add_correct(poses, TRUE, MODELS[object_id], SETTINGS)
    scored = [_one(pose, object_id=object_id).add_correct for pose in poses]
    assert verdicts.tolist() == scored and verdicts[0] and not verdicts.all()
    assert verdicts[1] == (MODELS[object_id].name == "cup")  # which is symmetric: ADD-S
