from dataclasses import replace

import numpy as np
import pytest
from scipy.ndimage import uniform_filter

from hlp.models.encoder import normals_with_depth, patch_input
from view_records import random_patches


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
