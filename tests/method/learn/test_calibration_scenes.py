"""Rendered scenes whose truth is known."""

import numpy as np
import pytest

from hlp.method.learn.calibration_scenes import calibration_scene
from hlp.records import Frame
from hlp.rendering.rasterizer import render_depth
from hlp.rendering.views import ViewsSettings
from refinement_scene import make_model

VIEWS = ViewsSettings()


def scene(number, present=True, views=VIEWS):
    return calibration_scene(make_model(), present, views, (), number, seed=0)


def test_the_object_is_where_the_truth_says():
    """The image's depth agrees with the model over most of what is said to be visible."""
    model, agreeing = make_model(), []
    for number in range(4):
        frame = scene(number)
        target = frame.targets[0]  # the others are more of the same
        assert 0.3 <= target.visible_fraction <= 1.0
        shape = (frame.depth.shape[0], frame.depth.shape[1])
        rendered = render_depth(model.mesh, target.pose_cam_obj[None], frame.camera_matrix, shape)
        covered = rendered[0] > 0.0
        near = np.abs(frame.depth[covered] - rendered[0][covered]) < 0.02
        agreeing.append(near.mean() / target.visible_fraction)
    assert 0.5 < np.median(agreeing) <= 1.05


def test_equal_numbers_give_equal_scenes_and_others_do_not():
    one, same, other = scene(1), scene(1), scene(3)
    np.testing.assert_array_equal(one.rgb, same.rgb)
    np.testing.assert_array_equal(one.depth, same.depth)
    assert not np.array_equal(one.depth, other.depth)


def test_poses_are_those_of_the_views():
    """From above and upright: the object's z axis never points down in the image."""
    views = ViewsSettings(coverage="hemisphere", in_plane_min_deg=-30.0, in_plane_max_deg=30.0)
    for number in range(5):
        for target in scene(number, views=views).targets[:1]:
            up = target.pose_cam_obj[:3, 2]
            center = target.pose_cam_obj[:3, :3] @ make_model().centroid
            center = center + target.pose_cam_obj[:3, 3]
            # The camera looks along z, not at the object: up to the angle of the ray.
            assert up[2] < np.linalg.norm(center[:2]) / center[2] + 1e-6
            assert up[1] < 0.5


def test_frames_of_the_user_are_backgrounds():
    camera = np.array([[300.0, 0.0, 160.0], [0.0, 300.0, 120.0], [0.0, 0.0, 1.0]])
    rgb = np.full((240, 320, 3), 90, np.uint8)
    room = Frame(0, 0, rgb, np.full((240, 320), 2.5, np.float32), camera)
    frame = calibration_scene(make_model(), False, VIEWS, (room,), 1, seed=0)
    assert frame.targets == () and frame.rgb.dtype == np.uint8 and frame.depth.dtype == np.float32
    assert frame.depth.shape == (240, 320)
    np.testing.assert_array_equal(frame.camera_matrix, camera)
    assert np.median(frame.depth[frame.depth > 2.0]) == pytest.approx(2.5, abs=0.05)
