"""Patches with their codebook entries, and what is rebuilt of their features."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from box_scene import box_model
from hlp.codebook.entries import make_codebook
from hlp.geometry import rigid
from hlp.models.encoder import patch_input
from hlp.patches.local import LocalSettings
from hlp.patches.local_pool import cut_view_patches
from hlp.records import LocalPatches, Views
from hlp.rendering.light import FRONTAL_LIGHT
from hlp.rendering.rasterizer import render_rgbd
from hlp.runs.stage_samples import distances_on_object, entry_patch, reconstruct

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


class MeanColor:
    """An encoder whose features are the mean colour, and a decoder that paints it."""

    input = "rgbd"
    sees_color = True

    def __init__(self, kept: bool) -> None:
        self.kept = kept

    def encode(self, patches: LocalPatches) -> np.ndarray:
        return np.asarray(patches.color.mean(axis=(1, 2)) / 127.5 - 1.0)

    def decode(self, _: Path, features: np.ndarray) -> np.ndarray | None:
        painted = np.zeros((len(features), 4, 4, 4))
        painted[..., :3] = features[:, None, None]
        return painted if self.kept else None


def training(encoder: Any) -> Any:
    return SimpleNamespace(
        settings=SimpleNamespace(encoder=encoder),
        load_encoder=lambda: encoder,
        encoder=lambda: SimpleNamespace(folder=Path("encoder")),
    )


def patches(count: int) -> LocalPatches:
    rng = np.random.default_rng(0)
    return LocalPatches(
        rng.integers(0, 256, (count, 4, 4, 3)).astype(np.uint8),
        rng.uniform(-1, 1, (count, 4, 4)).astype(np.float32),
        np.ones((count, 4, 4), bool),
        np.zeros((count, 3)),
        np.zeros((count, 2)),
    )


def test_patches_stand_beside_what_is_rebuilt_of_their_features() -> None:
    found = reconstruct(training(MeanColor(kept=True)), "cat", patches(3))
    assert found is not None and found.name == "cat"
    np.testing.assert_array_equal(found.patches, patch_input(patches(3), "rgbd"))
    mean = found.patches[..., :3].mean(axis=(1, 2))
    np.testing.assert_allclose(found.rebuilt[:, 0, 0, :3], mean, atol=1e-6)


def test_nothing_is_shown_without_a_decoder_or_patches() -> None:
    assert reconstruct(training(MeanColor(kept=False)), "cat", patches(3)) is None
    assert reconstruct(training(SimpleNamespace(sees_color=False)), "cat", patches(3)) is None
    assert reconstruct(training(MeanColor(kept=True)), "cat", patches(0)) is None
