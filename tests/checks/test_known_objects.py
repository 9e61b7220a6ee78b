"""What known objects tell of frames, found or not, around a stand-in for the detector."""

import logging
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from faults import exchanged, with_depth, with_matrix
from hlp.checks import known_objects
from hlp.checks.corrections import EXCHANGED, Correction, check_gains
from hlp.checks.known_objects import (
    FaultWatch,
    check_by_search,
    exchange_gain,
    find_answers,
    known_gains,
)
from hlp.errors import InputError
from hlp.method.find.detections import Detection, Rejection, SearchResult
from hlp.refinement.pose_fit import PoseFit


def finder(truth):
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
        (lambda f: with_depth(f, 0.9), "depth scale", "0.9 times"),
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
    assert check_by_search(frames[:1], 0.95, finder(frames[0]), None) == []
    assert check_by_search(frames[:1], 0.02, lambda _: 0.02, None) == []


def test_where_an_object_is_found_only_colours_are_tried(frames):
    """The other searches take seconds each, and could not bring enough."""
    searched = []
    check_by_search(frames[:1], 0.65, lambda frame: searched.append(frame) or 0.0, None)
    assert len(searched) == 1


def test_the_only_frame_must_show_it_more_clearly(frames):
    def find_best(frame):
        return 0.85 if frame.camera_matrix[0, 0] > frames[0].camera_matrix[0, 0] else 0.05

    assert check_by_search(frames[:1], 0.05, find_best, None) == []
    assert len(check_by_search([frames[0], frames[0]], 0.05, find_best, None)) == 1


@pytest.mark.parametrize("fault", [lambda f: with_matrix(f, 0.5), exchanged])
def test_the_change_must_find_objects_in_the_next_frame_too(frames, fault):
    """In the first frame something looks like the object after a change, in the second nothing."""
    planted, find_best = fault(frames[0]), finder(frames[0])
    other = with_depth(planted, 3)
    assert len(check_by_search([planted, planted, other], 0.05, find_best, None)) == 1
    assert check_by_search([planted, other], 0.05, find_best, None) == []


def answer(name, pose, cost=0.2, score=0.95, agreement=0.9):
    fit = PoseFit(cost, agreement, agreement, 1.0, 1.0)
    return Detection(name, score, pose, 1.0, 0.0, 1.0, pose[None], None, fit)


class Stub:
    """A detector: it finds something of a score, or raises; a pose costs what `cost` says."""

    def __init__(self, models, score=0.95, cost=lambda depth, matrix: 0.3):
        self.models = {model.name: model for model in models.values()}
        self.objects = tuple(self.models)
        self.score, self.cost, self.asked, self.refined = score, cost, [], 0

    def search(self, rgb, depth, camera_matrix, *others):
        self.asked.append(others)
        if self.score is None:
            raise InputError("no camera has that focal length")
        return SearchResult([SimpleNamespace(score=self.score)] if self.score else [], [])

    def refine(self, rgb, depth, camera_matrix, name, pose):
        self.refined += 1
        return answer(name, pose, self.cost(depth, camera_matrix), self.score)


def test_the_answers_to_a_frame(frames, models):
    names, masks = [model.name for model in models.values()], {frames[0].key: "marked"}
    stub = Stub(models, 0.7)
    assert [found.score for found in find_answers(stub, names, masks, frames[0])] == [0.7]
    find_answers(stub, names[:1], masks, frames[1])
    assert stub.asked == [(names, 1, 0.0, "marked"), (names[:1], 1, 0.0, None)]
    assert find_answers(Stub(models, None), names, {}, frames[0]) == []
    assert find_answers(stub, names, {}, with_depth(frames[0], 100)) == []
    assert len(stub.asked) == 2


def gains(frames, models, depth=1.0, focal=1.0, cost_of_a_tenth=0.04, score=0.95):
    """Gains of frames with a fault: a pose costs the more, the farther they are from the truth."""
    measured = []
    for truth in frames:

        def cost(seen, matrix, truth=truth):
            off = abs(np.log(np.median(seen) / np.median(truth.depth)))
            off += abs(np.log(matrix[0, 0] / truth.camera_matrix[0, 0]))
            return 0.2 + cost_of_a_tenth * off / np.log(1 / 0.9)

        frame, target = Correction(depth, focal).frame(truth), truth.targets[0]
        stub = Stub(models, score, cost)
        image = frame.rgb, frame.depth, frame.camera_matrix
        stated = stub.refine(*image, models[target.object_id].name, target.pose_cam_obj)
        found = known_gains(stub, frame, [stated])
        measured.append({each: found[each] for each in found if each != EXCHANGED})
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
    (finding,) = check_gains(gains(frames, models, depth, focal))
    assert finding.kind == kind and words in finding.problem and finding.where == "3 frames"


def test_healthy_frames_have_no_finding(frames, models):
    measured = gains(frames, models)
    assert all(max(each.values()) < -0.03 for each in measured)
    assert check_gains(measured) == []


def test_small_gains_and_uncertain_answers_say_nothing(frames, models):
    assert check_gains(gains(frames, models, 0.9, cost_of_a_tenth=0.01)) == []
    assert gains(frames, models, 0.9, score=0.7) == [{}] * 3
    assert known_gains(Stub(models), frames[0], []) == {}


def test_a_larger_correction_is_tried_only_where_the_smaller_one_helps(frames, models):
    target, tried = frames[0].targets[0], []
    focal, depth = frames[0].camera_matrix[0, 0], np.median(frames[0].depth)

    def cost(seen, matrix):
        tried.append(matrix[0, 0] / focal * np.median(seen) / depth)
        return 0.1 if matrix[0, 0] < focal else 0.3

    stub = Stub(models, cost=cost)
    given = [answer(models[target.object_id].name, target.pose_cam_obj, agreement=0.7)]
    found = known_gains(stub, frames[0], given)
    np.testing.assert_allclose(tried, [0.9, 1 / 0.9, 1.33, 0.77, 0.67, 0.53], rtol=1e-5)
    assert found[Correction(focal=2.0)] == found[Correction(focal=1.33)] < 0
    assert EXCHANGED not in found  # a pose whose shape does not fit
    stub.refine = lambda *_: None
    assert known_gains(stub, frames[0], given) == {}


def test_exchanged_colours_are_found_and_true_ones_are_not(frames, models):
    placed = [
        [(models[target.object_id], target.pose_cam_obj) for target in frame.targets]
        for frame in frames
    ]
    true = list(map(exchange_gain, frames, placed))
    wrong = list(map(exchange_gain, map(exchanged, frames), placed))
    for one, other in zip(true, wrong, strict=True):
        np.testing.assert_allclose(one[EXCHANGED], -other[EXCHANGED], atol=1e-6)
    assert check_gains(true) == []
    (finding,) = check_gains(wrong)
    assert finding.kind == "colours" and finding.where == "3 frames"
    grey = [(replace(m, mesh=replace(m.mesh, colored=False)), pose) for m, pose in placed[0]]
    assert exchange_gain(frames[0], grey) == {}


@pytest.fixture
def said(caplog):
    caplog.set_level(logging.INFO, "hlp.checks.known_objects")
    return lambda: [record.getMessage() for record in caplog.records]


def watch(detector, frames, score=0.95):
    """The first object of each frame, at its true pose and with this score, is the answer."""
    names = {model.object_id: model.name for model in detector.models.values()}
    watch = FaultWatch(detector, None)
    for frame in frames:
        target = frame.targets[0]
        found = answer(names[target.object_id], target.pose_cam_obj, score=score)
        if score >= 0.5:
            watch.add(frame, SearchResult([found], []))
        else:
            watch.add(frame, SearchResult([], [Rejection(found.object, "low", found)]))
    watch.end()


def test_healthy_frames_say_nothing_and_six_are_examined(frames, models, said):
    detector = Stub(models)
    watch(detector, frames * 3)
    assert said() == []
    assert detector.refined == 6 * 4 and detector.asked == []


@pytest.mark.parametrize(("count", "seen"), [(1, "this frame alone"), (8, "6 frames")])
def test_a_fault_is_said_once(frames, models, said, count, seen):
    """Objects fit better where depth is more than 5 % larger than the frames'."""
    true = np.median(frames[0].depth)
    detector = Stub(models, cost=lambda depth, _: 0.1 if np.median(depth) > 1.05 * true else 0.3)
    watch(detector, [frames[0]] * count)
    (line,) = said()
    assert line.startswith(f"warning: depth scale: {seen}: depth may be 0.9 times")


def test_a_camera_of_other_images_is_said_at_the_first_frame(frames, models, said):
    detector = Stub(models)
    watch(detector, [with_matrix(frames[0], 0.5, slice(0, 2)), frames[1]])
    assert said() and all("warning: intrinsics" in line for line in said())
    assert detector.refined == 0


@pytest.mark.parametrize(("count", "examined"), [(1, 1), (7, 6)])
def test_where_nothing_is_found_that_is_said_and_nothing_is_searched(
    frames, models, said, count, examined
):
    detector = Stub(models)
    watch(detector, [frames[0]] * count, score=0.05)
    assert f"found in none of {examined} frames. Less than 40 px" in said()[-1]
    assert detector.asked == []


def test_unregistered_depth_is_said(frames, models, said, monkeypatch):
    monkeypatch.setattr(known_objects, "check_registration", lambda seen: [f"{len(seen)} frames"])
    for count in (6, 2):
        watch(Stub(models), (frames * 2)[:count])
    assert said() == ["warning: 6 frames", "warning: 2 frames"]
