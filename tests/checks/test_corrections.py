"""What frames must say until a fault is named; corrections of frames and poses."""

import numpy as np
import pytest

from hlp.checks.corrections import EXCHANGED, Correction, check_gains
from hlp.geometry import project, transform

DEEPER = Correction(depth=0.9)


@pytest.mark.parametrize(
    ("gains", "named"),
    [([0.04], 0), ([0.04, 0.07], 0), ([0.04, 0.07, 0.04], 1), ([0.06], 1), ([0.07, 0.06], 1),
     ([0.07, None], 0), ([0.07, 0.07, None], 1), ([None], 0), ([], 0), ([0.02, 0.04, 0.02], 0),
     ([0.1, 0.1, -0.01, 0.1, -0.01], 0), ([0.1, 0.1, -0.01, 0.1], 1)],
)  # fmt: skip
@pytest.mark.parametrize(("correction", "scale"), [(DEEPER, 1.0), (EXCHANGED, 0.8 / 0.06)])
def test_three_frames_must_say_so_and_fewer_more_clearly(correction, scale, gains, named):
    findings = check_gains([{} if gain is None else {correction: scale * gain} for gain in gains])
    assert len(findings) == named
    count = sum(gain is not None for gain in gains)
    where = "this frame alone" if count == 1 else f"{count} frames"
    assert all(finding.where == where for finding in findings)


def test_one_fault_is_named_and_colours_first():
    frames = [{DEEPER: 0.2, Correction(focal=1.5): 0.3}] * 3
    (finding,) = check_gains(frames)
    assert finding.kind == "intrinsics" and "0.67 times" in finding.problem
    (finding,) = check_gains([gains | {EXCHANGED: 1.0} for gains in frames])
    assert finding.kind == "colours"


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
        project(after, corrected.camera_matrix), project(before, frames[0].camera_matrix)
    )
