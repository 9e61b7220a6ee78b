import re
from dataclasses import replace

import numpy as np
import pytest

from faults import exchanged, with_depth, with_matrix
from hlp.checks import true_poses
from hlp.checks.true_poses import FAULTS, Sample, agreement, check_true_colors, check_true_poses
from hlp.geometry import rigid


def _with_poses(frame, change):
    targets = [
        replace(target, pose_cam_obj=change(target.pose_cam_obj)) for target in frame.targets
    ]
    return replace(frame, targets=tuple(targets))


def _changed(frame, turn=lambda rotation: rotation, factor=1.0, shift=(0.0, 0.0, 0.0)):
    return _with_poses(frame, lambda p: rigid(turn(p[:3, :3]), factor * p[:3, 3] + shift))


PLANTED = {
    "depth x10": (lambda f: with_depth(f, 10), "depth scale", "10 times"),
    "depth x0.9": (lambda f: with_depth(f, 0.9), "depth scale", "0.9"),
    "focal x0.5": (lambda f: with_matrix(f, 0.5), "intrinsics", "about 0.5"),
    "focal x0.75": (lambda f: with_matrix(f, 0.75), "intrinsics", "about 0.75"),
    "focal x1.3": (lambda f: with_matrix(f, 1.3), "intrinsics", r"about 1\.[23]"),
    "focal x1.9": (lambda f: with_matrix(f, 1.9), "intrinsics", r"about (1\.9|2)"),
    "K of images half as large": (
        lambda f: with_matrix(f, 0.5, slice(0, 2)), "intrinsics", "images 0.5 times",
    ),
    "transposed rotations": (lambda f: _changed(f, np.transpose), "rotations", "transposed"),
    "inverted poses": (lambda f: _with_poses(f, np.linalg.inv), "poses", "camera to object"),
    "OpenGL's axes": (
        lambda f: _with_poses(f, lambda p: np.diag([1.0, -1, -1, 1]) @ p), "axes", "OpenGL",
    ),
    "poses in metres": (lambda f: _changed(f, factor=0.001), "pose unit", "0.001"),
    "depth x0.95": (lambda f: with_depth(f, 0.95), "depth scale", "0.95"),
    "poses 30 mm too far": (lambda f: _changed(f, shift=(0, 0, 0.03)), "poses", "30 mm too far"),
    "poses 30 mm beside": (lambda f: _changed(f, shift=(0.03, 0, 0)), "poses", "px beside"),
    "depth shifted": (
        lambda f: replace(f, depth=np.roll(f.depth, 20, axis=1)), "registration", r"\(20, 0\)",
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", PLANTED)
def test_a_planted_fault_is_named(frames, models, name):
    plant, kind, words = PLANTED[name]
    (finding,) = check_true_poses([plant(frame) for frame in frames], models)
    assert finding.kind == kind, str(finding)
    assert re.search(words, finding.problem), str(finding)


def test_meshes_in_centimetres_are_named(frames, models):
    small = {
        i: replace(m, proxy=replace(m.proxy, vertices=m.proxy.vertices * 0.1))
        for i, m in models.items()
    }
    (finding,) = check_true_poses(frames, small)
    assert finding.kind == "mesh unit" and "0.1 times" in finding.problem


def test_a_healthy_set_has_no_finding(frames, models):
    assert check_true_poses(frames, models) == []
    assert check_true_poses([replace(frame, targets=()) for frame in frames], models) == []


def test_poses_that_nothing_explains_are_named_as_such(frames, models):
    rng = np.random.default_rng(0)
    lost = [_changed(f, factor=1 + rng.uniform(0.3, 0.6)) for f in frames]
    lost = [_with_poses(f, lambda p: p @ np.diag([-1.0, 1, -1, 1])) for f in lost]
    (finding,) = check_true_poses(lost, models)
    assert finding.kind == "poses" and "no single known fault" in finding.problem


def test_undoing_a_fault_that_is_not_there_spoils_the_agreement(frames, models):
    """Otherwise that fault could not be told from none."""
    samples = [
        Sample(frame, models[t.object_id], t.pose_cam_obj)
        for frame in frames
        for t in frame.targets
    ]
    healthy = agreement(samples)
    assert healthy > 0.8
    for fault in FAULTS:
        if fault.kind not in {"registration", "rotations"}:  # small shifts, nearly symmetric turns
            assert agreement([fault.undo(sample) for sample in samples]) < healthy, fault


@pytest.mark.parametrize(("stated", "kind"), [(0.58, "intrinsics"), (0.1, "mesh unit")])
def test_a_tiny_mesh_that_fits_anywhere_explains_no_half_agreement(
    frames, models, monkeypatch, stated, kind
):
    """The shares are those of the mustard bottle's recording with focal lengths times 1.3."""
    size = {i: np.ptp(model.proxy.vertices) for i, model in models.items()}
    focal = frames[0].camera_matrix[0, 0]

    def share(samples):
        first = samples[0]
        if np.ptp(first.model.proxy.vertices) < 0.5 * size[first.model.object_id]:
            return 1.0
        return 0.95 if first.frame.camera_matrix[0, 0] == focal * 0.75 else stated

    monkeypatch.setattr(true_poses, "agreement", share)
    (finding,) = check_true_poses(frames, models)
    assert finding.kind == kind, str(finding)


def test_exchanged_colours_are_told_by_true_poses(frames, models):
    (finding,) = check_true_colors([exchanged(frame) for frame in frames], models)
    assert finding.kind == "colours" and check_true_colors(frames, models) == []
