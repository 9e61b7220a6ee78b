import dataclasses

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation
from waterfall_bounds import BOUNDS

from hlp.evaluation import errors
from hlp.evaluation.evaluator import FrameTruth, PackedDepth, add_correct, score_targets
from hlp.evaluation.settings import EvaluationSettings
from hlp.geometry import rigid
from hlp.records import Frame, Mesh, ObjectModel, PoseEstimate, Target
from hlp.rendering.rasterizer import render_depth

K = np.array([[570.0, 0.0, 80.0], [0.0, 570.0, 60.0], [0.0, 0.0, 1.0]])
SETTINGS = EvaluationSettings("test", ["cup"], 0.1, 5.0, 5.0, 0.5, 100, BOUNDS)
HALF_TURN = rigid(np.diag([-1.0, -1.0, 1.0]), np.zeros(3))
TRUE = rigid(Rotation.from_euler("xyz", [0.4, 0.2, 0.1]).as_matrix(), np.array([0.01, 0.0, 0.8]))


def _model(object_id, name, symmetries=None):
    box = trimesh.creation.box((0.06, 0.08, 0.10)).subdivide().subdivide()
    mesh = Mesh(
        np.array(box.vertices),
        np.array(box.faces),
        np.full((len(box.vertices), 3), 128, np.uint8),
        np.array(box.vertex_normals),
    )
    symmetries = np.eye(4)[None] if symmetries is None else symmetries
    diameter = float(np.linalg.norm([0.06, 0.08, 0.10]))
    return ObjectModel(object_id, name, mesh, mesh, diameter, symmetries, 0.08, 0.03)


MODELS = {
    1: _model(1, "cat"),
    2: _model(2, "cup", np.stack([np.eye(4), HALF_TURN])),
}


def _truth(*targets, frame_id=3, depth=None):
    return FrameTruth(6, frame_id, K, 160, targets, depth)


def _estimate(pose, object_id=1, score=0.5, frame_id=3):
    return PoseEstimate(6, frame_id, object_id, pose, score)


def _moved(dx=0.0, dz=0.0, degrees=0.0):
    turn = Rotation.from_euler("y", degrees, degrees=True).as_matrix()
    pose = TRUE.copy()
    pose[:3, :3] = turn @ pose[:3, :3]
    pose[:3, 3] += [dx, 0.0, dz]
    return pose


def _one(pose, settings=SETTINGS):
    return score_targets([_truth(Target(1, TRUE, 0.7))], MODELS, [_estimate(pose)], settings)[0]


def test_the_true_pose_is_right_in_every_respect():
    score = _one(TRUE)
    assert (score.add_correct, score.pose_correct, score.box_correct) == (True, True, True)
    assert (score.scene_id, score.frame_id, score.object_id) == (6, 3, 1)
    assert score.found and score.visible_fraction == 0.7
    assert score.add_error == 0.0 and score.box_iou == pytest.approx(1.0)
    assert (score.mssd_recall, score.mspd_recall) == (1.0, 1.0)


def test_ad_counts_below_a_tenth_of_the_diameter():
    threshold = 0.1 * MODELS[1].diameter
    assert _one(_moved(dx=threshold * 0.99)).add_correct
    assert not _one(_moved(dx=threshold * 1.01)).add_correct


def test_5cm5deg_wants_both():
    assert _one(_moved(dz=0.049)).pose_correct
    assert not _one(_moved(dz=0.051)).pose_correct
    assert _one(_moved(degrees=4.9)).pose_correct
    assert not _one(_moved(degrees=5.1)).pose_correct
    assert not _one(_moved(degrees=5.1, dz=0.049)).pose_correct


def test_iou_counts_from_its_threshold_on():
    pose = _moved(dx=0.02)
    iou = _one(pose).box_iou
    assert 0.3 < iou < 1
    assert _one(pose, dataclasses.replace(SETTINGS, iou=iou)).box_correct
    assert not _one(pose, dataclasses.replace(SETTINGS, iou=iou + 1e-6)).box_correct


@pytest.mark.parametrize("estimates", [[], [_estimate(None)], [_estimate(TRUE, frame_id=4)]])
def test_a_target_without_a_pose_is_wrong_with_infinite_errors(estimates):
    (score,) = score_targets([_truth(Target(1, TRUE))], MODELS, estimates, SETTINGS)
    assert not score.found
    assert (score.add_correct, score.pose_correct, score.box_correct) == (False, False, False)
    infinite = float("inf")
    assert (score.add_error, score.rotation_error, score.translation_error) == (infinite,) * 3
    assert (score.box_iou, score.mssd_recall, score.mspd_recall) == (0.0, 0.0, 0.0)


def test_an_object_that_no_target_asks_for_counts_neither_way():
    estimates = [_estimate(TRUE), _estimate(TRUE, object_id=2)]
    scores = score_targets([_truth(Target(1, TRUE))], MODELS, estimates, SETTINGS)
    assert len(scores) == 1


def test_the_policy_decides_which_objects_are_symmetric():
    truth, estimate = [_truth(Target(2, TRUE))], [_estimate(TRUE @ HALF_TURN, object_id=2)]
    (symmetric,) = score_targets(truth, MODELS, estimate, SETTINGS)
    assert symmetric.add_correct and symmetric.pose_correct
    assert symmetric.rotation_error == pytest.approx(0, abs=1e-9)
    strict = dataclasses.replace(SETTINGS, symmetric=[])
    (plain,) = score_targets(truth, MODELS, estimate, strict)
    assert not plain.add_correct and not plain.pose_correct
    assert plain.rotation_error == pytest.approx(np.pi)
    vertices = MODELS[2].mesh.vertices
    assert plain.add_error == pytest.approx(errors.add(TRUE @ HALF_TURN, TRUE, vertices))


def test_bop_recalls_average_over_ten_thresholds():
    # 0.22 of the diameter: below the thresholds 0.25 … 0.50, which are six of ten.
    assert _one(_moved(dz=0.22 * MODELS[1].diameter)).mssd_recall == pytest.approx(0.6)
    # 160 px wide images have thresholds of 1.25 … 12.5 px.
    score = _one(_moved(dx=0.004))
    offset = errors.mspd(_moved(dx=0.004), TRUE, MODELS[1].mesh.vertices, np.eye(4)[None], K)
    assert score.mspd_recall == pytest.approx(np.mean(offset < 1.25 * np.arange(1, 11)))
    assert 0 < score.mspd_recall < 1


def test_vsd_needs_depth_and_is_perfect_at_the_truth():
    depth = render_depth(MODELS[1].mesh, TRUE[None], K, (120, 160))[0]
    truth = _truth(Target(1, TRUE), depth=PackedDepth.of(depth))
    (right,) = score_targets([truth], MODELS, [_estimate(TRUE)], SETTINGS)
    (wrong,) = score_targets([truth], MODELS, [_estimate(_moved(dx=0.3))], SETTINGS)
    (missing,) = score_targets([truth], MODELS, [], SETTINGS)
    assert (right.vsd_recall, wrong.vsd_recall, missing.vsd_recall) == (1.0, 0.0, 0.0)
    assert np.isnan(_one(TRUE).vsd_recall)


def test_instances_are_matched_once_each_the_surest_estimate_first():
    left, right = _moved(dx=-0.05), _moved(dx=0.05)
    truth = _truth(Target(1, left), Target(1, right))
    near_left = _moved(dx=-0.04)
    estimates = [_estimate(near_left, score=0.9), _estimate(left, score=0.3)]
    first, second = score_targets([truth], MODELS, estimates, SETTINGS)
    assert first.translation_error == pytest.approx(0.01)
    assert second.translation_error == pytest.approx(0.10)
    (only, lost) = score_targets([truth], MODELS, [_estimate(right)], SETTINGS)
    assert not only.found and lost.add_correct


def test_a_wrong_estimate_takes_no_target_from_a_right_one():
    left, right = _moved(dx=-0.05), _moved(dx=0.05)
    truth = _truth(Target(1, left), Target(1, right))
    wrong = _moved(dx=-0.05, dz=0.03)
    estimates = [_estimate(wrong, score=0.9), _estimate(left, score=0.3)]
    first, second = score_targets([truth], MODELS, estimates, SETTINGS)
    assert first.add_correct and first.add_error == 0.0
    assert second.found and not second.add_correct


def test_as_many_estimates_count_as_there_are_targets():
    left, right = _moved(dx=-0.05), _moved(dx=0.05)
    wrong = _moved(dz=0.4)
    given = [(wrong, 0.9), (left, 0.8), (right, 0.7)]
    estimates = [_estimate(pose, score=score) for pose, score in given]
    truth = _truth(Target(1, left), Target(1, right))
    first, second = score_targets([truth], MODELS, estimates, SETTINGS)
    assert first.add_correct and not second.add_correct
    assert second.mssd_recall == 0.0


def test_without_named_objects_the_models_symmetries_decide():
    by_model = dataclasses.replace(SETTINGS, symmetric=None)
    assert [by_model.is_symmetric(MODELS[i]) for i in (1, 2)] == [False, True]
    estimate = [_estimate(TRUE @ HALF_TURN, object_id=2)]
    (score,) = score_targets([_truth(Target(2, TRUE))], MODELS, estimate, by_model)
    assert score.add_correct


def test_bops_errors_are_measured_on_another_mesh_if_there_is_one():
    estimate = [_estimate(_moved(degrees=35.0))]
    small = Mesh(
        MODELS[1].mesh.vertices * 0.5,
        MODELS[1].mesh.faces,
        MODELS[1].mesh.colors,
        MODELS[1].mesh.normals,
    )
    truth = [_truth(Target(1, TRUE))]
    (own,) = score_targets(truth, MODELS, estimate, SETTINGS)
    (other,) = score_targets(truth, MODELS, estimate, SETTINGS, {1: small})
    assert other.mssd_recall > own.mssd_recall
    assert other.add_error == own.add_error


def test_of_two_estimates_for_one_target_the_surer_counts():
    estimates = [_estimate(TRUE, score=0.2), _estimate(_moved(dx=0.3), score=0.8)]
    (score,) = score_targets([_truth(Target(1, TRUE))], MODELS, estimates, SETTINGS)
    assert not score.add_correct


def test_a_pose_with_nan_is_an_error_that_names_it():
    broken = TRUE.copy()
    broken[0, 3] = np.nan
    with pytest.raises(ValueError, match="object 1 in scene 6, frame 3"):
        score_targets([_truth(Target(1, TRUE))], MODELS, [_estimate(broken)], SETTINGS)


def test_a_target_without_a_model_is_an_error():
    with pytest.raises(ValueError, match="object 9"):
        score_targets([_truth(Target(9, TRUE))], MODELS, [], SETTINGS)


def test_truth_of_a_frame_drops_the_images_unless_wanted():
    frame = Frame(
        6, 3, np.zeros((120, 160, 3), np.uint8), np.ones((120, 160)), K, (Target(1, TRUE),)
    )
    assert FrameTruth.of(frame).depth is None
    depth = FrameTruth.of(frame, with_depth=True).depth
    assert depth is not None
    np.testing.assert_array_equal(depth.unpack(), frame.depth)
    assert FrameTruth.of(frame).width == 160
    assert FrameTruth.of(frame).targets == frame.targets


@pytest.mark.parametrize("key", ["add_fraction", "translation_cm", "iou", "bootstrap"])
def test_a_threshold_that_is_not_positive_is_named(key):
    with pytest.raises(ValueError, match=f"^{key} is 0: it must be"):
        dataclasses.replace(SETTINGS, **{key: 0})


@pytest.mark.parametrize("object_id", [1, 2])
def test_verdicts_of_many_poses_are_those_of_scoring_them_one_by_one(object_id):
    moved = [_moved(0.02 * dx, 0.0, 8.0 * turn) for dx, turn in np.ndindex(4, 4)]
    poses = np.stack([TRUE, TRUE @ HALF_TURN, *moved])
    scores = [
        score_targets(
            [_truth(Target(object_id, TRUE))], MODELS, [_estimate(pose, object_id)], SETTINGS
        )[0]
        for pose in poses
    ]
    verdicts = add_correct(poses, TRUE, MODELS[object_id], SETTINGS)
    assert verdicts.tolist() == [score.add_correct for score in scores]
    assert verdicts[0] and not verdicts.all()
    assert verdicts[1] == (MODELS[object_id].name == "cup")  # which is symmetric: ADD-S
