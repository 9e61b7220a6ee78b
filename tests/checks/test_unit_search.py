from dataclasses import replace

import numpy as np
import pytest

from hlp.checks.unit_search import check_by_search


def finder(truth, size_matters=True):
    """Stands for a detector: it finds the object where depth, focal length and colours are true."""

    def find_best(frame):
        depth = np.median(frame.depth) / np.median(truth.depth)
        focal = frame.camera_matrix[0, 0] / truth.camera_matrix[0, 0]
        off = max(abs(np.log(depth)), abs(np.log(focal)))
        red = (frame.rgb[..., 0] == truth.rgb[..., 0]).all()
        return float(np.exp(-8 * off)) * (0.95 if red else 0.7)

    return find_best


def _focal(frame, factor):
    matrix = frame.camera_matrix.copy()
    matrix[[0, 1], [0, 1]] *= factor
    return replace(frame, camera_matrix=matrix)


@pytest.mark.parametrize(
    ("plant", "kind", "words"),
    [
        (lambda f: replace(f, depth=f.depth * np.float32(10)), "depth scale", "10 times"),
        (lambda f: replace(f, depth=f.depth * np.float32(0.1)), "depth scale", "0.1 times"),
        (lambda f: replace(f, depth=f.depth * np.float32(0.9)), "depth scale", "0.909 times"),
        (lambda f: _focal(f, 0.5), "intrinsics", "0.5 times"),
        (lambda f: _focal(f, 1.9), "intrinsics", "1.9 times"),
        (lambda f: replace(f, rgb=np.ascontiguousarray(f.rgb[..., ::-1])), "colours", "red and"),
    ],
)
def test_the_fault_that_hides_the_object_is_named(frames, plant, kind, words):
    (finding,) = check_by_search([plant(frames[0])], finder(frames[0]))
    assert finding.kind == kind and words in finding.problem, str(finding)


def test_an_object_that_is_found_or_absent_has_no_finding(frames):
    assert check_by_search(frames[:1], finder(frames[0])) == []
    assert check_by_search(frames[:1], lambda _: 0.02) == []
    assert check_by_search([], lambda _: 0.0) == []
