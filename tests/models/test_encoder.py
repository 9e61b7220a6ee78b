from dataclasses import replace

import numpy as np
import pytest
import torch
from scipy.ndimage import uniform_filter

from hlp.models.encoder import normals_with_depth, patch_input
from hlp.models.network_encoders import AutoencoderSettings, ContrastiveSettings
from hlp.models.network_training import PatchEncoder
from hlp.models.onnx_export import export_network
from networks import trained
from view_records import random_patches

CAE = AutoencoderSettings("cae", "rgbd", 24, (8, 12, 16))
CONTRASTIVE = ContrastiveSettings("contrastive", "normals_depth", 24, (8, 12, 16))


def images_of(patches, settings):
    return torch.from_numpy(patch_input(patches, settings.input)).permute(0, 3, 1, 2)


def encoder(folder, settings):
    """An encoder as detection loads it, and the network that was trained."""
    torch.manual_seed(0)
    network = trained(PatchEncoder(settings.widths, settings.dimension), 32)
    sample = images_of(random_patches(64, seed=9), settings)
    export_network(network, sample, folder / "encoder", levels=False)
    return settings.load(folder, 2, "cpu"), network


@pytest.mark.parametrize("settings", [CAE, CONTRASTIVE])
def test_features_are_the_networks_own_but_for_rounding(settings, tmp_path):
    """Those of the contrastive encoder have unit length."""
    patches = random_patches(20)
    made, network = encoder(tmp_path, settings)
    features = made.encode(patches)
    with torch.no_grad():
        exact = network.eval()(images_of(patches, settings)).numpy()
    if settings is CONTRASTIVE:
        exact /= np.linalg.norm(exact, axis=1, keepdims=True)
        np.testing.assert_allclose(np.linalg.norm(features, axis=1), 1.0, atol=1e-6)
    assert features.shape == (20, 24) and features.dtype == np.float32
    error = np.linalg.norm(features - exact, axis=1) / np.linalg.norm(exact, axis=1)
    assert error.max() < 0.05
    assert made.sees_color == (settings is CAE)
    assert made.encode(random_patches(0)).shape == (0, 24)


def test_a_patch_has_one_feature_in_whatever_company(tmp_path):
    patches = random_patches(1100)  # three chunks, the last one smaller
    made, _ = encoder(tmp_path, CONTRASTIVE)
    together = made.encode(patches)
    for rows in (np.arange(1), np.arange(500, 530), np.arange(1020, 1100), np.arange(600)):
        np.testing.assert_array_equal(made.encode(patches[rows]), together[rows])


def surface_normals(depth, valid):
    return normals_with_depth(depth, valid)[..., :3]


def plane(slope_x, slope_y, size=32):
    """Depth of a plane; pixel centres lie at (i + ½)·2/p − 1, in halves of the metric size."""
    axis = (np.arange(size) + 0.5) * 2 / size - 1
    return (slope_x * axis[None, :] + slope_y * axis[:, None])[None].astype(np.float32)


@pytest.mark.parametrize("slope", [(0.0, 0.0), (0.5, -0.2), (-0.3, 0.6)])
def test_normals_of_a_tilted_plane_are_exact(slope):
    depth = plane(*slope)
    normals = surface_normals(depth, np.ones(depth.shape, dtype=bool))
    expected = np.array([slope[0], slope[1], -1.0])
    expected /= np.linalg.norm(expected)
    inner = normals[0, 3:-3, 3:-3]  # smoothing and differences: 3 px
    np.testing.assert_allclose(inner, np.broadcast_to(expected, inner.shape), atol=1e-5)


def test_what_is_not_valid_does_not_reach_the_normals():
    depth = plane(0.4, 0.1)
    valid = np.ones(depth.shape, dtype=bool)
    valid[:, :, 20:] = False
    other = np.where(valid, depth, np.float32(9.0))
    first, second = surface_normals(depth, valid), surface_normals(other, valid)
    # Differences at the edge take in one pixel beyond, smoothed from valid ones alone.
    np.testing.assert_allclose(first[:, :, :19], second[:, :, :19], atol=1e-5)


def test_normals_are_what_whole_array_operations_give():
    rng = np.random.default_rng(3)
    depth = (rng.random((6, 32, 32)) * 2 - 1).astype(np.float32)
    valid = rng.random((6, 32, 32)) < 0.3  # holes that smoothing does not reach
    weight = valid.astype(np.float64)
    smooth = depth * weight
    for _ in range(2):
        smooth, weight = (uniform_filter(x, (0, 3, 3), mode="constant") for x in (smooth, weight))
    surface = np.where(weight > 0.05, smooth / np.maximum(weight, 1e-3), depth)
    padded = np.pad(surface, ((0, 0), (1, 1), (1, 1)), mode="edge")
    dx = (padded[:, 1:-1, 2:] - padded[:, 1:-1, :-2]) * 8
    dy = (padded[:, 2:, 1:-1] - padded[:, :-2, 1:-1]) * 8
    expected = np.stack([dx, dy, -np.ones_like(dx)], axis=-1)
    expected /= np.linalg.norm(expected, axis=-1, keepdims=True)
    np.testing.assert_allclose(
        surface_normals(depth, valid), expected * valid[..., None], atol=1e-5
    )


def test_channels_of_each_kind():
    patches = random_patches(5, seed=1)
    rgbd = patch_input(patches, "rgbd")
    assert rgbd.dtype == np.float32
    np.testing.assert_allclose(rgbd[..., :3], patches.color / 127.5 - 1, atol=1e-6)
    np.testing.assert_array_equal(rgbd[..., 3], patches.depth)
    shape = patch_input(patches, "normals_depth")
    np.testing.assert_array_equal(shape[..., :3], surface_normals(patches.depth, patches.valid))
    np.testing.assert_array_equal(shape[..., 3], patches.depth)
    assert np.abs(shape).max() <= 1.0 + 1e-6
    colourless = replace(patches, color=patches.color[..., :0])
    np.testing.assert_array_equal(patch_input(colourless, "normals_depth"), shape)
