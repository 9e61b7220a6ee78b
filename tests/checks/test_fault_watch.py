"""What is noticed in the first frames of a call, around a detector that stands for the real one."""

import logging
from dataclasses import replace

import numpy as np
import pytest

from hlp.checks import known_objects
from hlp.checks.known_objects import FaultWatch
from hlp.data.synthetic.objects import demo_objects
from hlp.data.synthetic.scenes import SyntheticScenes, SyntheticSettings
from hlp.method.find.detections import Detection, Rejection, SearchResult
from hlp.refinement.pose_fit import PoseFit

MODELS = {model.name: model for model in demo_objects().values()}
NOTHING = SearchResult([], [Rejection("bear", "nothing looks like it", None)])


@pytest.fixture(scope="module")
def frames():
    settings = SyntheticSettings(scenes=7, objects=(2, 2), clutter=(1, 1), width=320, height=240)
    scenes = SyntheticScenes(settings)
    return [scenes.load(key) for key in scenes.keys]


def found(frame, score=0.95):
    """The first object of a frame, at its true pose."""
    target = frame.targets[0]
    (name,) = (name for name, model in MODELS.items() if model.object_id == target.object_id)
    pose, fit = target.pose_cam_obj, PoseFit(0.2, 0.9, 0.9, 1.0, 1.0)
    answer = Detection(name, score, pose, 1.0, 0.0, 1.0, pose[None], None, fit)
    if score >= 0.5:
        return SearchResult([answer], [])
    return SearchResult([], [Rejection(name, "low", answer)])


class Stub:
    """A detector that refines to a cost and finds nothing."""

    def __init__(self, cost=lambda depth: 0.3):
        self.models, self.objects = MODELS, tuple(MODELS)
        self.cost = cost
        self.refined, self.searched = 0, 0

    def refine(self, rgb, depth, camera_matrix, name, pose):
        self.refined += 1
        fit = PoseFit(self.cost(depth), 0.9, 0.9, 1.0, 1.0)
        return Detection(name, 0.95, pose, 1.0, 0.0, 1.0, pose[None], None, fit)

    def search(self, *given):
        self.searched += 1
        return NOTHING


def further(frame, cost):
    """A detector whose objects fit better where depth is more than 5 % larger than a frame's."""
    true = np.median(frame.depth)
    return Stub(lambda depth: cost if np.median(depth) > 1.05 * true else 0.3)


@pytest.fixture
def said(caplog):
    caplog.set_level(logging.INFO, "hlp.checks.known_objects")
    return lambda: [record.getMessage() for record in caplog.records]


def watched(detector, frames, answers=None):
    watch = FaultWatch(detector, None)
    for frame, answer in zip(frames, answers or map(found, frames), strict=True):
        watch.add(frame, answer)
    watch.end()


def test_healthy_frames_say_nothing_and_six_are_examined(frames, said):
    detector = Stub()
    watched(detector, frames)
    assert said() == []
    assert detector.refined == 6 * 4 and detector.searched == 0


def test_the_only_frame_of_a_call_is_examined_at_the_end(frames, said):
    detector = further(frames[0], 0.14)
    watch = FaultWatch(detector, None)
    watch.add(frames[0], found(frames[0]))
    assert detector.refined == 0
    watch.end()
    (line,) = said()
    assert line.startswith("warning: depth scale: this frame alone: depth may be 0.9 times")
    watched(Stub(), frames[:1])
    assert len(said()) == 1


def test_a_fault_is_said_once(frames, said):
    detector = further(frames[0], 0.1)
    watched(detector, [replace(frame, depth=frames[0].depth) for frame in frames])
    (line,) = said()
    assert line.startswith("warning: depth scale: 6 frames: depth may be 0.9 times")


def test_a_camera_of_other_images_is_said_at_the_first_frame(frames, said):
    detector = Stub()
    matrix = frames[0].camera_matrix * np.array([[0.5], [0.5], [1.0]])
    watched(detector, [replace(frames[0], camera_matrix=matrix)])
    count = len(said())
    assert count >= 1 and all("warning: intrinsics" in line for line in said())
    watched(detector, [replace(frames[0], camera_matrix=matrix), frames[1]])
    assert len(said()) == 2 * count and detector.refined == 0


def test_where_nothing_is_found_that_is_said_and_nothing_is_searched(frames, said):
    for count, answer in ((1, NOTHING), (7, found(frames[0], score=0.05))):
        detector = Stub()
        watched(detector, frames[:count], [answer] * count)
        assert f"found in none of {min(count, 6)} frames; `hlp doctor`" in said()[-1]
        assert detector.searched == 0


@pytest.mark.parametrize(("answered", "missed"), [(1, 1), (2, 1), (3, 2)])
def test_few_frames_without_answers_are_not_searched(frames, said, answered, missed):
    detector = Stub()
    answers = [found(frame) for frame in frames[:answered]] + [NOTHING] * missed
    watched(detector, frames[: answered + missed], answers)
    assert detector.searched == 0 and said() == []


def test_unregistered_depth_is_said_without_colours(frames, said, monkeypatch):
    monkeypatch.setattr(known_objects, "check_registration", lambda seen: [f"{len(seen)} frames"])
    watched(Stub(), frames)
    watched(Stub(), frames[:2])
    assert said() == ["warning: 6 frames", "warning: 2 frames"]
