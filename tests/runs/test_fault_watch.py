"""What is noticed in the first frames of a call, around a detector that stands for the real one."""

import logging
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from hlp.data.synthetic.objects import demo_objects
from hlp.data.synthetic.scenes import SyntheticScenes, SyntheticSettings
from hlp.method.find.detections import Detection, Rejection, SearchResult
from hlp.refinement.pose_fit import PoseFit
from hlp.runs import fault_watch
from hlp.runs.fault_watch import FaultWatch

MODELS = {each.name: each for each in demo_objects().values()}
IDS = {each.object_id: each for each in MODELS.values()}


@pytest.fixture(scope="module")
def frames():
    settings = SyntheticSettings(scenes=7, objects=(2, 2), clutter=(1, 1), width=320, height=240)
    scenes = SyntheticScenes(settings)
    return [scenes.load(key) for key in scenes.keys]


def seen(frame, score=0.95, cost=0.2):
    """The first object of a frame, at its true pose."""
    target = frame.targets[0]
    pose, fit = target.pose_cam_obj, PoseFit(cost, 0.9, 0.9, 1.0, 1.0)
    name = IDS[target.object_id].name
    return Detection(name, score, pose, 1.0, 0.0, 1.0, pose[None], None, fit)


def found(frame, score=0.95, cost=0.2):
    answer = seen(frame, score, cost)
    if score >= 0.5:
        return SearchResult([answer], [])
    return SearchResult([], [Rejection(answer.object, "low", answer)])


class Stub:
    """A detector that refines to a cost, and finds an object in a frame if `visible` says so."""

    def __init__(self, cost=lambda depth, camera_matrix: 0.3, visible=lambda frame: False):
        self.models, self.objects = MODELS, tuple(MODELS)
        self.cost, self.visible = cost, visible
        self.refined, self.searched = 0, 0

    def refine(self, rgb, depth, camera_matrix, name, pose):
        self.refined += 1
        fit = PoseFit(self.cost(depth, camera_matrix), 0.9, 0.9, 1.0, 1.0)
        return Detection(name, 0.95, pose, 1.0, 0.0, 1.0, pose[None], None, fit)

    def search(self, rgb, depth, camera_matrix, objects, max_instances, min_score):
        self.searched += 1
        frame = SimpleNamespace(rgb=rgb, depth=depth, camera_matrix=camera_matrix)
        score = 0.9 if self.visible(frame) else 0.1
        return SearchResult([SimpleNamespace(score=score)], [])


@pytest.fixture
def said(caplog):
    caplog.set_level(logging.INFO, "hlp.runs.fault_watch")
    return lambda: [each.getMessage() for each in caplog.records]


def watched(detector, frames, answers):
    watch = FaultWatch(detector, None)
    for frame, answer in zip(frames, answers, strict=True):
        watch.add(frame, answer)
    watch.end()
    return watch


def test_healthy_frames_say_nothing_and_six_are_examined(frames, said):
    detector = Stub()
    watched(detector, frames, [found(each) for each in frames])
    assert said() == []
    assert detector.refined == 6 * 4 and detector.searched == 0


def test_the_only_frame_of_a_call_is_examined_at_the_end(frames, said):
    true = np.median(frames[0].depth)
    detector = Stub(lambda depth, _: 0.17 if np.median(depth) > 1.05 * true else 0.3)
    watch = FaultWatch(detector, None)
    watch.add(frames[0], found(frames[0]))
    assert detector.refined == 0
    watch.end()
    (line,) = said()
    assert line.startswith("warning: depth scale: this frame alone: depth may be 0.9 times")
    watched(Stub(), frames[:1], [found(frames[0])])
    assert len(said()) == 1


def test_a_camera_of_other_images_is_said_at_the_first_frame(frames, said):
    detector = Stub()
    watch = FaultWatch(detector, None)
    matrix = frames[0].camera_matrix * np.array([[0.5], [0.5], [1.0]])
    watch.add(replace(frames[0], camera_matrix=matrix), found(frames[0]))
    assert len(said()) >= 1 and all("warning: intrinsics" in each for each in said())
    count = len(said())
    watch.add(frames[1], found(frames[1]))
    watch.end()
    assert len(said()) == count and detector.refined == 0


def test_a_fault_is_said_once_and_ends_the_watch(frames, said):
    true = np.median(frames[0].depth)
    detector = Stub(lambda depth, _: 0.1 if np.median(depth) > 1.05 * true else 0.3)
    alike = [replace(each, depth=frames[0].depth) for each in frames]
    watched(detector, alike, [found(each) for each in alike])
    (line,) = said()
    assert line.startswith("warning: depth scale: 3 frames: depth may be 0.9 times")
    assert detector.refined == 3 * 4


@pytest.mark.parametrize(
    ("visible", "said_last"),
    [
        (lambda each: each.camera_matrix[0, 0] < 200, "warning: intrinsics: frame"),
        (lambda each: False, "nothing was found; `hlp doctor`"),
    ],
)
def test_nothing_found_in_most_frames_is_searched_for_the_reason(frames, said, visible, said_last):
    detector = Stub(visible=visible)
    watched(detector, frames, [found(each, score=0.05) for each in frames])
    first, last = said()
    assert "is not found in most frames: trying other units" in first
    assert last.startswith(said_last)
    assert 8 < detector.searched < 15


NOTHING = SearchResult([], [Rejection("bear", "nothing looks like it", None)])


def test_the_reason_is_searched_for_in_one_frame_too(frames, said):
    detector = Stub()
    watched(detector, frames[:1], [NOTHING])
    first, last = said()
    assert "is not found in this frame: trying other units" in first
    assert last.startswith("nothing was found") and 8 < detector.searched < 15


@pytest.mark.parametrize(("answered", "missed"), [(1, 1), (2, 1), (3, 2)])
def test_few_frames_without_answers_are_not_searched(frames, said, answered, missed):
    detector = Stub()
    answers = [found(each) for each in frames[:answered]] + [NOTHING] * missed
    watched(detector, frames[: answered + missed], answers)
    assert detector.searched == 0 and said() == []


def test_unregistered_depth_is_said_without_colours(frames, said, monkeypatch):
    monkeypatch.setattr(fault_watch, "check_registration", lambda each: [f"{len(each)} frames"])
    watched(Stub(), frames, [found(each) for each in frames])
    assert said() == ["warning: 6 frames"]
    watched(Stub(), frames[:2], [found(each) for each in frames[:2]])
    assert len(said()) == 1
