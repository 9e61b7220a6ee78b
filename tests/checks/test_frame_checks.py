"""What is seen in frames alone: unreadable files, intrinsics, units."""

from dataclasses import replace

import numpy as np
import pytest

from faults import FOCAL, with_depth, with_matrix
from hlp.checks.frame_checks import (
    check_depth_scale,
    check_intrinsics,
    check_object_size,
    read_frames,
)
from hlp.errors import DataError
from hlp.records import Frame


def test_a_healthy_frame_has_no_finding(frames, models):
    for frame in frames:
        assert check_intrinsics(frame) == []
        assert check_depth_scale(frame, list(models.values())) == []
        assert check_depth_scale(frame, []) == []
    assert check_object_size(list(models.values())) == []


@pytest.mark.parametrize(
    ("factor", "where", "words"),
    [
        *((factor, slice(0, 2), "far from their middle") for factor in (0.5, 0.67, 1.5)),
        (0.005, FOCAL, "no depth camera"),  # in millimetres
        (0.6, (1, 1), "very different"),
    ],
)
def test_impossible_intrinsics_and_those_of_images_of_another_size_are_named(
    frames, factor, where, words
):
    (finding,) = check_intrinsics(with_matrix(frames[0], factor, where))
    assert finding.kind == "intrinsics" and words in finding.problem


@pytest.mark.parametrize("factor", [10.0, 0.1])
def test_depth_in_another_unit_is_named(frames, models, factor):
    (finding,) = check_depth_scale(with_depth(frames[0], factor), list(models.values()))
    assert finding.kind == "depth scale" and "Give depth_scale" in finding.advice


def test_without_objects_only_impossible_distances_are_named(frames):
    far = with_depth(frames[0], 12)
    (finding,) = check_depth_scale(far, [])
    assert "few depth cameras" in finding.problem
    assert check_depth_scale(replace(far, depth=np.zeros_like(far.depth)), []) == []


def test_a_mesh_in_centimetres_is_named(models):
    tiny = replace(models[1], diameter=models[1].diameter * 0.1)
    (finding,) = check_object_size([tiny, models[2]])
    assert finding.where == tiny.name and "mesh_scale=0.01" in finding.advice


FRAME = Frame(0, 0, np.zeros((8, 8, 3), np.uint8), np.ones((8, 8), np.float32), np.eye(3))
KEYS = [f"000001_{i:06d}" for i in range(9)]


def _loader(frame, refused):
    def load(key):
        if key in refused:
            raise DataError(f"{key} is odd")
        return frame

    return load


@pytest.mark.parametrize(("odd", "shown", "more"), [(1, 1, ""), (3, 3, ""), (7, 3, "4 more")])
def test_of_many_files_that_cannot_be_read_the_first_are_named(odd, shown, more):
    kept, findings = read_frames(_loader(FRAME, KEYS[:odd]), KEYS, 9)
    assert len(kept) == len(KEYS) - odd
    assert [item.kind for item in findings] == ["files"] * shown
    assert [finding.where[:13] for finding in findings] == KEYS[:shown]
    assert more in findings[-1].where and ("more" in findings[-1].where) == bool(more)


def test_frames_whose_values_make_no_sense_are_kept_with_a_finding():
    load, read = _loader(FRAME, KEYS[:2]), _loader(FRAME, KEYS[1:2])
    kept, findings = read_frames(load, KEYS, 9, read)
    assert len(kept) == len(KEYS) - 1
    assert {(finding.kind, finding.where) for finding in findings} == {
        ("values", KEYS[0]),
        ("files", KEYS[1]),
    }
