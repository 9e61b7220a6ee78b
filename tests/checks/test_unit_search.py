from types import SimpleNamespace

import numpy as np
import pytest

from faults import exchanged, with_depth, with_matrix
from hlp.checks.corrections import best_score, check_by_search
from hlp.errors import InputError
from hlp.method.find.detections import SearchResult


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
        (lambda f: with_matrix(f, 0.5), "intrinsics", "0.5 times"),
        (lambda f: with_matrix(f, 1.9), "intrinsics", "1.9 times"),
        (exchanged, "colours", "red and"),
    ],
)
def test_the_fault_that_hides_the_object_is_named(frames, plant, kind, words):
    planted, find_best = plant(frames[0]), finder(frames[0])
    (finding,) = check_by_search([planted], find_best(planted), find_best)
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

    objects = ("bear",)

    def __init__(self, models, score):
        self.models = {model.name: model for model in models.values()}
        self.score, self.asked = score, []

    def search(self, rgb, depth, camera_matrix, objects, max_instances, min_score):
        self.asked.append(objects)
        if self.score is None:
            raise InputError("no camera has that focal length")
        return SearchResult([SimpleNamespace(score=self.score)] if self.score else [], [])


def test_the_best_score_of_a_frame(frames, models):
    stub = Stub(models, 0.7)
    assert best_score(stub, frames[0]) == 0.7
    assert best_score(stub, frames[0], ["can"]) == 0.7
    assert stub.asked == [None, ["can"]]
    assert best_score(Stub(models, 0.0), frames[0]) == 0.0
    assert best_score(Stub(models, None), frames[0]) == 0.0
    far = with_depth(frames[0], 100)
    assert best_score(stub, far) == 0.0 and len(stub.asked) == 2
