from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from faults import exchanged, with_depth, with_matrix
from hlp.checks.corrections import (
    Correction,
    check_by_search,
    check_corrections,
    correction_gains,
    find_answers,
)
from hlp.errors import InputError
from hlp.geometry import project, transform
from hlp.method.find.detections import Detection, SearchResult
from hlp.refinement.pose_fit import PoseFit


def finder(truth, size_matters=True):
    """Stands for a detector: it finds the object where depth, focal length and colours are true."""

    def find_best(frame):
        depth = np.median(frame.depth) / np.median(truth.depth)
        focal = frame.camera_matrix[0, 0] / truth.camera_matrix[0, 0]
        off = max(abs(np.log(depth)), abs(np.log(focal)))
        red = (frame.rgb[..., 0] == truth.rgb[..., 0]).all()
        return float(np.exp(-6 * off)) * (0.98 if red else 0.7)

    return find_best


@pytest.mark.parametrize(
    ("plant", "kind", "words"),
    [
        (lambda f: with_depth(f, 10), "depth scale", "10 times"),
        (lambda f: with_depth(f, 0.1), "depth scale", "0.1 times"),
        (lambda f: with_depth(f, 0.9), "depth scale", "0.91 times"),
        (lambda f: with_depth(f, 4), "depth scale", "units of 0.25 mm, not 1"),
        (lambda f: with_matrix(f, 0.5), "intrinsics", "0.5 times"),
        (lambda f: with_matrix(f, 1.9), "intrinsics", "1.9 times"),
        (exchanged, "colours", "red and"),
    ],
)
def test_the_fault_that_hides_the_object_is_named(frames, plant, kind, words):
    planted, find_best = plant(frames[0]), finder(frames[0])
    (finding,) = check_by_search([planted], find_best(planted), find_best, 1.0)
    assert finding.kind == kind and words in finding.problem, str(finding)


def test_an_object_that_is_found_or_absent_has_no_finding(frames):
    assert check_by_search(frames[:1], 0.95, finder(frames[0])) == []
    assert check_by_search(frames[:1], 0.02, lambda _: 0.02) == []
    assert check_by_search([], 0.0, lambda _: 0.9) == []


def test_where_an_object_is_found_only_colours_are_tried(frames):
    """The other searches take seconds each, and could not bring enough."""
    searched = []
    check_by_search(frames[:1], 0.65, lambda frame: searched.append(frame) or 0.0)
    assert len(searched) == 1


def test_the_only_frame_must_show_it_more_clearly(frames):
    def find_best(frame):
        return 0.85 if frame.camera_matrix[0, 0] > frames[0].camera_matrix[0, 0] else 0.05

    assert check_by_search(frames[:1], 0.05, find_best) == []
    assert len(check_by_search([frames[0], frames[0]], 0.05, find_best)) == 1


@pytest.mark.parametrize("fault", [lambda f: with_matrix(f, 0.5), exchanged])
def test_the_change_must_find_objects_in_the_next_frame_too(frames, fault):
    """In the first frame something looks like the object after a change, in the second nothing."""
    planted, find_best = fault(frames[0]), finder(frames[0])
    other = with_depth(planted, 3)
    assert len(check_by_search([planted, planted, other], 0.05, find_best)) == 1
    assert check_by_search([planted, other], 0.05, find_best) == []


class Stub:
    """A detector with one answer, or an error, for a frame."""

    def __init__(self, models, score):
        self.models = {model.name: model for model in models.values()}
        self.score, self.asked = score, []

    def search(self, rgb, depth, camera_matrix, *others):
        self.asked.append(others)
        if self.score is None:
            raise InputError("no camera has that focal length")
        return SearchResult([SimpleNamespace(score=self.score)] if self.score else [], [])


def test_the_answers_to_a_frame(frames, models):
    names, masks = [model.name for model in models.values()], {frames[0].key: "marked"}
    stub = Stub(models, 0.7)
    assert [found.score for found in find_answers(stub, names, masks, frames[0])] == [0.7]
    find_answers(stub, names[:1], masks, frames[1])
    assert stub.asked == [(names, 1, 0.0, "marked"), (names[:1], 1, 0.0, None)]
    assert find_answers(Stub(models, None), names, {}, frames[0]) == []
    assert find_answers(stub, names, {}, with_depth(frames[0], 100)) == []
    assert len(stub.asked) == 2


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
    assert all(len(each) == 8 and max(each.values()) < -0.03 for each in measured)
    assert check_corrections(measured) == []
    assert check_corrections([]) == []


def test_small_gains_and_uncertain_answers_say_nothing(frames, models):
    assert check_corrections(gains(frames, models, 0.9, cost_of_a_tenth=0.01)) == []
    assert gains(frames, models, 0.9, score=0.7) == [{}] * 3
    assert correction_gains(frames[0], {}, [], refiner(frames[0])) == {}


def test_three_frames_must_say_so_and_fewer_more_clearly():
    deeper = Correction(depth=0.9)

    def count(*gains):
        return len(check_corrections([{} if g is None else {deeper: g} for g in gains]))

    assert [count(0.04), count(0.04, 0.07), count(0.04, 0.07, 0.04)] == [0, 0, 1]
    assert [count(0.06), count(0.07, 0.06), count(0.07, None), count(0.07, 0.07, None)] == [
        1, 1, 0, 1,
    ]  # fmt: skip
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
    assert found[Correction(focal=2.0)] == found[Correction(focal=1.33)] < 0
    nowhere = correction_gains(frames[0], {model.name: model}, [given], lambda *_: None)
    assert nowhere == {}


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
