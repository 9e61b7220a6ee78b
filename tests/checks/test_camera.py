from dataclasses import replace

import numpy as np
import pytest

from hlp.checks.frame_checks import check_depth_scale, check_intrinsics, check_object_size


def _with_matrix(frame, change):
    matrix = frame.camera_matrix.copy()
    change(matrix)
    return replace(frame, camera_matrix=matrix)


def test_a_healthy_frame_has_no_finding(frames, models):
    for frame in frames:
        assert check_intrinsics(frame) == []
        assert check_depth_scale(frame, list(models.values())) == []
        assert check_depth_scale(frame, []) == []
    assert check_object_size(list(models.values())) == []


@pytest.mark.parametrize("factor", [0.5, 0.67, 1.5])
def test_intrinsics_of_images_of_another_size_are_named(frames, factor):
    def change(matrix):
        matrix[:2] *= factor

    (finding,) = check_intrinsics(_with_matrix(frames[0], change))
    assert finding.kind == "intrinsics" and "far from their middle" in finding.problem


def test_impossible_and_exchanged_numbers_are_named(frames):
    def millimetres(matrix):
        matrix[[0, 1], [0, 1]] = 3.6

    def exchanged(matrix):
        matrix[1, 1] *= 0.6

    (finding,) = check_intrinsics(_with_matrix(frames[0], millimetres))
    assert "no depth camera" in finding.problem
    (finding,) = check_intrinsics(_with_matrix(frames[0], exchanged))
    assert "very different" in finding.problem


@pytest.mark.parametrize("factor", [10.0, 0.1])
def test_depth_in_another_unit_is_named(frames, models, factor):
    wrong = replace(frames[0], depth=(frames[0].depth * factor).astype(np.float32))
    (finding,) = check_depth_scale(wrong, list(models.values()))
    assert finding.kind == "depth scale" and "Give depth_scale" in finding.advice


def test_without_objects_only_impossible_distances_are_named(frames):
    far = replace(frames[0], depth=frames[0].depth * np.float32(12))
    (finding,) = check_depth_scale(far, [])
    assert "few depth cameras" in finding.problem
    assert check_depth_scale(replace(far, depth=np.zeros_like(far.depth)), []) == []


def test_a_mesh_in_centimetres_is_named(models):
    tiny = replace(models[1], diameter=models[1].diameter * 0.1)
    (finding,) = check_object_size([tiny, models[2]])
    assert finding.where == tiny.name and "mesh_scale=0.01" in finding.advice
