"""Patches with their codebook entries, and what is rebuilt of their features."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from box_scene import box_model
from hlp.codebook.entries import make_codebook
from hlp.geometry import rigid
from hlp.patches.local import LocalSettings
from hlp.patches.local_pool import cut_view_patches
from hlp.records import Views
from hlp.rendering.rasterizer import render_rgbd
from hlp.rendering.shading import FRONTAL_LIGHT
from hlp.runs.stage_samples import distances_on_object, entry_patch

CAMERA = np.array([[150.0, 0.0, 31.5], [0.0, 150.0, 31.5], [0.0, 0.0, 1.0]])
SIZE = 0.06


def box_views() -> Views:
    """The box from four sides, each in three turns about the optical axis."""
    poses, images = [], []
    for yaw in (20, 110, 200, 290):
        for roll in (0, 40, 80):
            turn = Rotation.from_euler("yz", [yaw, roll], degrees=True)
            poses.append(rigid(turn.as_matrix(), np.array([0.0, 0.0, 0.6])))
            images.append(render_rgbd(box_model().mesh, poses[-1], CAMERA, (64, 64), FRONTAL_LIGHT))
    rgb, depth = (np.stack(parts) for parts in zip(*images, strict=True))
    return Views(1, rgb, depth.astype(np.float32), np.stack(poses), CAMERA)


@pytest.mark.parametrize("view", [0, 4, 11])
def test_an_entrys_patch_is_the_one_that_it_was_made_from(view: int) -> None:
    views, local = box_views(), LocalSettings()
    y, x = np.nonzero(views.depth[view] > 0)
    pixels = np.stack([x, y], axis=1)[:: len(x) // 5]
    cut = cut_view_patches(views, view, pixels, SIZE, local, True)
    poses = np.repeat(views.poses_cam_obj[view][None], len(cut), axis=0)
    codebook = make_codebook(1, np.zeros((len(cut), 4)), cut.points_cam, poses, 1.0)
    for entry in range(len(cut)):
        found = entry_patch(views, codebook, entry, SIZE, local)
        np.testing.assert_array_equal(found.pixels[0], cut.pixels[entry])
        np.testing.assert_array_equal(found.color[0], cut.color[entry])
        np.testing.assert_array_equal(found.depth[0], cut.depth[entry])


def test_places_that_look_the_same_are_no_distance_apart() -> None:
    half_turn = np.diag([-1.0, -1.0, 1.0, 1.0])
    box = replace(box_model(), symmetries=np.stack([np.eye(4), half_turn]))
    points = np.array([[0.05, 0.02, 0.0], [-0.05, -0.02, 0.0], [-0.05, -0.02, 0.03]])
    apart = distances_on_object(points, points[0], box)
    np.testing.assert_allclose(apart, [0.0, 0.0, 0.03], atol=1e-12)
