"""Tracking through sequences of a simulated camera, whose poses are known."""

from dataclasses import astuple, replace

import numpy as np
import pytest
import trimesh

from hlp import CameraImage, Detector, TrackingSettings
from hlp.errors import InputError
from hlp.geometry import project, rigid, rotation_distance, transform
from hlp.method import tracker as tracker_module
from hlp.method.find.detections import SearchResult
from hlp.method.find.estimator import PoseEstimator
from hlp.method.tracker import Track, part_near
from hlp.records import Frame
from moving_scene import SimulatedCamera, is_right, path
from tiny_method import MODELS

BEAR, CAN = MODELS["bear"], MODELS["can"]
NEAR = (-0.05, -0.02, 0.7)


@pytest.fixture(scope="module")
def detector(learnt):
    return Detector.load(learnt)


def hidden(poses, first, last):
    poses = poses.copy()
    poses[first:last] = np.nan
    return poses


def test_an_object_is_detected_once_and_then_tracked(detector):
    poses = path(BEAR, 6, NEAR)
    images = list(SimulatedCamera({"bear": poses}, MODELS))
    answers = list(detector.track(images, ["bear"], 1))
    assert [[one.tracked for one in found] for found in answers] == [[False]] + [[True]] * 5
    assert {found[0].track for found in answers} == {0}
    for (found,), true in zip(answers, poses, strict=True):
        assert found.object == "bear" and found.score >= 0.5 and found.seconds > 0.0
        assert is_right(found.pose_cam_obj, true, BEAR)
    first = images[0]
    (alone,) = detector.detect(first.rgb, first.depth, first.camera_matrix, ["bear"], 1)
    np.testing.assert_array_equal(answers[0][0].pose_cam_obj, alone.pose_cam_obj)
    assert answers[0][0].score == alone.score
    tracker = detector.tracker(["bear"], 1)
    for image, (expected,) in zip(images[:2], answers, strict=False):
        (found,) = tracker.update(image)
        np.testing.assert_array_equal(found.pose_cam_obj, expected.pose_cam_obj)
    tracker.reset()
    assert [found.tracked for found in tracker.update(images[2])] == [False]


def test_a_lost_object_is_detected_again_in_the_same_frame(detector):
    """It jumps by 20 cm and half a turn: no refiner gets there, and one number stays."""
    here = path(BEAR, 2, NEAR)
    there = path(BEAR, 2, (0.13, 0.03, 0.75)) @ trimesh.transformations.rotation_matrix(
        2.0, [0, 0, 1], BEAR.centroid
    )
    poses = np.concatenate([here, there])
    answers = list(detector.track(SimulatedCamera({"bear": poses}, MODELS), ["bear"], 1))
    for found, true in zip(answers, poses, strict=True):
        assert len(found) == 1 and is_right(found[0].pose_cam_obj, true, BEAR)
    assert [found[0].tracked for found in answers] == [False, True, False, True]
    assert {found[0].track for found in answers} == {0}


@pytest.mark.parametrize("way", ["follow", "search"])
def test_a_symmetric_object_keeps_one_of_its_poses(learnt, monkeypatch, way):
    """Whether it is tracked or found again: both give the pose turned by a half here."""
    detector = Detector.load(learnt)
    about = trimesh.transformations.rotation_matrix(np.pi, [0, 0, 1], BEAR.centroid)
    model = replace(detector.models["bear"], symmetries=np.stack([np.eye(4), about]))
    with detector._alone() as estimator:
        estimator.learnt.models[model.object_id] = model
    poses = path(BEAR, 3, NEAR)
    first, *rest = SimulatedCamera({"bear": poses}, MODELS)
    tracker = detector.tracker(["bear"], 1, TrackingSettings(min_score=0.0))
    (before,) = tracker.update(first)
    turned = [pose @ about for pose in poses[1:]]
    given = iter(turned)
    if way == "follow":
        monkeypatch.setattr(PoseEstimator, "follow", lambda *_: next(given))
    else:
        sort = tracker_module.sort_answers

        def sort_turned(*of):
            found = sort(*of).detections
            return SearchResult([replace(one, pose_cam_obj=next(given)) for one in found], [])

        monkeypatch.setattr(tracker_module, "follow", lambda *_: None)
        monkeypatch.setattr(tracker_module, "sort_answers", sort_turned)
    for image, true in zip(rest, poses[1:], strict=True):
        (found,) = tracker.update(image)
        assert (found.track, found.tracked) == (before.track, way == "follow")
        np.testing.assert_allclose(found.pose_cam_obj, true, atol=1e-9)
        np.testing.assert_allclose(found.equivalent_poses, [true, true @ about], atol=1e-9)


def test_an_object_that_is_gone_is_not_found_and_why_is_said(detector):
    poses = hidden(path(BEAR, 4, NEAR), 2, 3)
    tracker = detector.tracker(["bear"], 1)
    results = [tracker.search(image) for image in SimulatedCamera({"bear": poses}, MODELS)]
    assert [len(result.detections) for result in results] == [1, 1, 0, 1]
    (rejection,) = results[2].rejections
    assert rejection.object == "bear" and rejection.reason
    assert not any(results[number].rejections for number in (0, 1, 3))
    assert not results[3].detections[0].tracked


def test_objects_and_instances_keep_their_numbers(detector):
    """Two bears and a can, which move past each other."""
    paths = {
        "bear#1": path(BEAR, 5, (-0.12, -0.02, 0.7)),
        "bear#2": path(BEAR, 5, (0.02, -0.05, 0.75)),
        "can": path(CAN, 5, (0.12, 0.06, 0.65), step_mm=-3.0),
    }
    answers = list(detector.track(SimulatedCamera(paths, MODELS), None, 2))
    owners = {}
    for index, found in enumerate(answers):
        for name, poses in paths.items():
            model = MODELS[name.split("#")[0]]
            (match,) = [e for e in found if is_right(e.pose_cam_obj, poses[index], model)]
            assert match.object == model.name
            assert owners.setdefault(match.track, name) == name
        assert all(one.tracked for one in found if one.track in owners) or index == 0


def test_further_instances_are_searched_every_so_many_frames(detector):
    late = hidden(path(BEAR, 6, (0.05, -0.05, 0.75)), 0, 2)
    paths = {"bear#1": path(BEAR, 6, (-0.12, -0.02, 0.7)), "bear#2": late}
    for every, expected in ((3, [1, 1, 1, 2, 2, 2]), (None, [1] * 6)):
        settings = TrackingSettings(search_every=every)
        camera = SimulatedCamera(paths, MODELS)
        answers = list(detector.track(camera, ["bear"], 2, settings))
        assert [len(found) for found in answers] == expected


def test_a_wrong_frame_is_refused_and_forgets_nothing(detector):
    one, two = SimulatedCamera({"bear": path(BEAR, 2, NEAR)}, MODELS)
    tracker = detector.tracker(["bear"], 1)
    tracker.update(one)
    with pytest.raises(InputError, match="depth has negative"):
        tracker.update(CameraImage(two.rgb, -two.depth, two.camera_matrix))
    with pytest.raises(InputError, match="rgb, depth and camera_matrix"):
        tracker.update(two.rgb)
    assert [one.tracked for one in tracker.update(two)] == [True]


def test_the_predicted_pose_moves_on_by_one_more_step():
    """On a path of constant velocity the prediction is the next pose."""
    poses = path(BEAR, 3, NEAR, step_mm=12.0, turn_deg=7.0)
    track = Track(0, BEAR.object_id, 1.0, poses[1], poses[0])
    last, predicted = track.start_poses(BEAR.centroid, prediction=True)
    np.testing.assert_allclose(last, poses[1], atol=1e-12)
    np.testing.assert_allclose(predicted, poses[2], atol=1e-9)
    (only,) = track.start_poses(BEAR.centroid, prediction=False)
    np.testing.assert_array_equal(only, last)
    sheared = poses[1].copy()
    sheared[:3, :3] *= 1.01  # what thousands of products would come to
    (start,) = Track(0, BEAR.object_id, 1.0, sheared).start_poses(BEAR.centroid, True)
    np.testing.assert_allclose(start[:3, :3] @ start[:3, :3].T, np.eye(3), atol=1e-12)
    assert rotation_distance(start[:3, :3], poses[1][:3, :3]) < 1e-6


def test_a_part_of_a_frame_judges_a_pose_as_the_whole_does(detector):
    """The part is a window of the image, with the camera that sees the same points in it."""
    poses = path(BEAR, 2, NEAR)
    (image, _) = SimulatedCamera({"bear": poses}, MODELS)
    with detector._alone() as estimator:
        model = detector.models["bear"]
        frame = Frame(0, 0, image.rgb, image.depth.astype(np.float32), image.camera_matrix)
        whole = estimator.prepare(frame)
        part = part_near(whole, model, poses)
        rows, columns = part.frame.depth.shape
        assert 0 < rows * columns < 0.6 * frame.depth.size
        low = (image.camera_matrix - part.frame.camera_matrix)[:2, 2].astype(int)
        window = slice(low[1], low[1] + rows), slice(low[0], low[0] + columns)
        np.testing.assert_array_equal(part.frame.depth, frame.depth[window])
        np.testing.assert_array_equal(part.frame.rgb, frame.rgb[window])
        seen = project(transform(poses[0], model.mesh.vertices), part.frame.camera_matrix)
        beside = 0.4 * model.diameter * image.camera_matrix[0, 0] / poses[0, 2, 3]
        assert np.ptp(seen, axis=0).max() > 20
        assert seen.min() > beside or (low == 0).any()
        assert ((columns, rows) - seen.max(axis=0) > beside).all()
        expected, found = (
            astuple(context.fits.measure(model.object_id, poses[0])) for context in (whole, part)
        )
        np.testing.assert_allclose(found, expected, rtol=1e-3, atol=1e-3)
        # Where the object is not in the image, the part is the whole.
        for places in ([(9.0, 0.0, 0.7)], [(0.0, 0.0, 0.0)], np.zeros((0, 3))):
            elsewhere = rigid(np.eye(3), np.array(places))
            assert part_near(whole, model, elsewhere) is whole
