from dataclasses import replace

import numpy as np
import pytest

from hlp.checks.corrections import CorrectedFits, Correction, check_corrections, correction_gains
from hlp.geometry import project, transform
from hlp.method.find.detections import Detection
from hlp.refinement.pose_fit import PoseFit


def answer(name, pose, cost=0.2, score=0.95):
    fit = PoseFit(cost, 0.9, 0.9, 1.0, 1.0)
    return Detection(name, score, pose, 1.0, 0.0, 1.0, pose[None], None, fit)


def refiner(truth, cost_of_a_tenth=0.04, score=0.95):
    """Stands for the refiner: a pose costs the more, the farther a frame is from the truth."""

    def refine(frame, given):
        off = abs(np.log(np.median(frame.depth) / np.median(truth.depth)))
        off += abs(np.log(frame.camera_matrix[0, 0] / truth.camera_matrix[0, 0]))
        cost = 0.2 + cost_of_a_tenth * off / np.log(1 / 0.9)
        return answer(given.object, given.pose_cam_obj, cost, score)

    return refine


def planted(truth, depth=1.0, focal=1.0):
    return Correction(depth, focal).frame(truth)


def gains(frames, models, depth=1.0, focal=1.0, **found):
    """Gains of frames with a fault, at the pose of the first object of each."""
    measured = []
    for truth in frames:
        frame, refine = planted(truth, depth, focal), refiner(truth, **found)
        model = models[truth.targets[0].object_id]
        stated = refine(frame, answer(model.name, truth.targets[0].pose_cam_obj))
        measured.append(correction_gains(frame, {model.name: model}, [stated], refine))
    return measured


@pytest.mark.parametrize(
    ("depth", "focal", "kind", "words"),
    [
        (0.9, 1.0, "depth scale", "depth may be 0.9 times"),
        (1 / 0.9, 1.0, "depth scale", "depth may be 1.1 times"),
        (1.0, 0.5, "intrinsics", "focal length may be 0.5 times"),
        (1.0, 0.75, "intrinsics", "focal length may be 0.75 times"),
        (1.0, 1.3, "intrinsics", "focal length may be 1.3 times"),
        (1.0, 1.9, "intrinsics", "focal length may be 1.9 times"),
    ],
)
def test_a_wrong_unit_or_focal_length_is_named(frames, models, depth, focal, kind, words):
    (finding,) = check_corrections(gains(frames, models, depth, focal))
    assert finding.kind == kind and words in finding.problem and finding.where == "3 frames"


def test_healthy_frames_have_no_finding(frames, models):
    measured = gains(frames, models)
    assert all(len(each.gains) == 8 and max(each.gains.values()) < -0.03 for each in measured)
    assert check_corrections(measured) == []
    assert check_corrections([]) == []


def test_small_gains_and_uncertain_answers_say_nothing(frames, models):
    assert check_corrections(gains(frames, models, 0.9, cost_of_a_tenth=0.01)) == []
    assert gains(frames, models, 0.9, score=0.7) == [CorrectedFits(False, {})] * 3
    assert correction_gains(frames[0], {}, [], refiner(frames[0])).gains == {}


def test_three_frames_must_say_so_and_fewer_more_clearly():
    deeper = Correction(depth=0.9)

    def count(*found, certain=True):
        gains = [{} if gain is None else {deeper: gain} for gain in found]
        return len(check_corrections([CorrectedFits(certain, each) for each in gains]))

    assert [count(0.016), count(0.016, 0.03), count(0.016, 0.03, 0.016)] == [0, 0, 1]
    assert [count(0.02), count(0.05, 0.02), count(0.05, None), count(0.05, 0.05, None)] == [
        1, 1, 0, 1,
    ]  # fmt: skip
    assert [count(0.05, certain=False), count(0.06, certain=False)] == [0, 1]
    assert [count(0.1, 0.1, -0.01, 0.1, -0.01), count(0.1, 0.1, -0.01, 0.1)] == [0, 1]


def test_a_larger_correction_is_tried_only_where_the_smaller_one_helps(frames, models):
    model = models[frames[0].targets[0].object_id]
    tried = []

    def refine(frame, given):
        tried.append(frame.camera_matrix[0, 0] / frames[0].camera_matrix[0, 0])
        return replace(given, fit=replace(given.fit, cost=0.3 if tried[-1] > 1 else 0.1))

    given = answer(model.name, frames[0].targets[0].pose_cam_obj)
    found = correction_gains(frames[0], {model.name: model}, [given], refine)
    np.testing.assert_allclose(sorted(tried), [0.53, 0.67, 0.77, 1.0, 1.0, 1.33])
    assert found.certain
    assert found.gains[Correction(focal=2.0)] == found.gains[Correction(focal=1.33)] < 0
    nowhere = correction_gains(frames[0], {model.name: model}, [given], lambda *_: None)
    assert nowhere.gains == {}


@pytest.mark.parametrize(("depth", "focal"), [(0.9, 1.0), (1.0, 1.5), (1.0, 0.53)])
def test_the_corrected_pose_shows_the_object_at_the_same_pixel(frames, models, depth, focal):
    target = frames[0].targets[0]
    centroid = models[target.object_id].centroid[None]
    correction = Correction(depth, focal)
    pose = correction.pose(target.pose_cam_obj, centroid[0])
    before, after = (transform(each, centroid) for each in (target.pose_cam_obj, pose))
    np.testing.assert_allclose(after[0, 2], before[0, 2] * depth)
    np.testing.assert_array_equal(pose[:3, :3], target.pose_cam_obj[:3, :3])
    corrected = correction.frame(frames[0])
    np.testing.assert_allclose(
        project(after, corrected.camera_matrix),
        project(before, frames[0].camera_matrix),
    )
