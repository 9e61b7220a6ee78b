from dataclasses import replace

import numpy as np
import pytest
import torch
from torch.nn import functional

from hlp.models.encoder_input import (
    encoder_input,
    patch_depth,
    patch_input,
    sees_color,
    surface_normals,
)
from hlp.records import LocalPatches


def plane(slope_x, slope_y, size=32):
    """Depth of a plane; pixel centres lie at (i + ½)·2/p − 1, in halves of the metric size."""
    axis = (torch.arange(size) + 0.5) * 2 / size - 1
    return (slope_x * axis[None, :] + slope_y * axis[:, None])[None]


@pytest.mark.parametrize("slope", [(0.0, 0.0), (0.5, -0.2), (-0.3, 0.6)])
def test_normals_of_a_tilted_plane_are_exact(slope):
    depth = plane(*slope)
    normals = surface_normals(depth, torch.ones_like(depth, dtype=torch.bool))
    expected = np.array([slope[0], slope[1], -1.0])
    expected /= np.linalg.norm(expected)
    inner = normals[0, :, 3:-3, 3:-3].permute(1, 2, 0).numpy()  # smoothing and differences: 3 px
    np.testing.assert_allclose(inner, np.broadcast_to(expected, inner.shape), atol=1e-5)


def test_normals_are_unit_vectors_where_valid_and_0_elsewhere():
    gen = torch.Generator().manual_seed(0)
    depth = torch.rand((4, 32, 32), generator=gen)
    valid = torch.rand((4, 32, 32), generator=gen) < 0.6
    normals = surface_normals(depth, valid).permute(0, 2, 3, 1)
    np.testing.assert_allclose(normals[valid].norm(dim=1), 1.0, atol=1e-5)
    assert (normals[~valid] == 0).all()
    assert (normals[valid][:, 2] < 0).all()  # towards the camera


def test_what_is_not_valid_does_not_reach_the_normals():
    depth = plane(0.4, 0.1)
    valid = torch.ones_like(depth, dtype=torch.bool)
    valid[:, :, 20:] = False
    other = torch.where(valid, depth, torch.full_like(depth, 9.0))
    first, second = surface_normals(depth, valid), surface_normals(other, valid)
    # Differences at the edge take in one pixel beyond, smoothed from valid ones alone.
    torch.testing.assert_close(first[..., :19], second[..., :19], atol=1e-5, rtol=0)


def test_normals_are_what_whole_array_operations_give():
    gen = torch.Generator().manual_seed(3)
    depth = torch.rand((6, 32, 32), generator=gen) * 2 - 1
    valid = torch.rand((6, 32, 32), generator=gen) < 0.3  # holes that smoothing does not reach
    weight = valid.float()[:, None]
    smooth = depth[:, None] * weight
    for _ in range(2):
        smooth, weight = (functional.avg_pool2d(x, 3, 1, padding=1) for x in (smooth, weight))
    surface = torch.where(weight > 0.05, smooth / weight.clamp(min=1e-3), depth[:, None])
    padded = functional.pad(surface, (1, 1, 1, 1), mode="replicate")
    dx = (padded[:, :, 1:-1, 2:] - padded[:, :, 1:-1, :-2]) * 8
    dy = (padded[:, :, 2:, 1:-1] - padded[:, :, :-2, 1:-1]) * 8
    expected = functional.normalize(torch.cat([dx, dy, -torch.ones_like(dx)], dim=1), dim=1)
    found = surface_normals(depth, valid)
    torch.testing.assert_close(found, expected * valid[:, None], atol=1e-5, rtol=0)


def random_patches(count=5):
    rng = np.random.default_rng(1)
    return LocalPatches(
        rng.integers(0, 256, (count, 32, 32, 3)).astype(np.uint8),
        rng.uniform(-1, 1, (count, 32, 32)).astype(np.float32),
        rng.random((count, 32, 32)) < 0.9,
        np.zeros((count, 3)),
        np.zeros((count, 2)),
    )


def test_channels_of_each_kind():
    patches = random_patches()
    depth, valid = patch_depth(patches)
    rgbd = patch_input(patches, "rgbd").numpy()
    np.testing.assert_allclose(
        rgbd[:, :3], patches.color.transpose(0, 3, 1, 2) / 127.5 - 1, atol=1e-6
    )
    np.testing.assert_array_equal(rgbd[:, 3], patches.depth)
    shape = patch_input(patches, "normals_depth")
    torch.testing.assert_close(shape[:, :3], surface_normals(depth, valid))
    np.testing.assert_array_equal(shape[:, 3], patches.depth)
    assert shape.abs().max() <= 1.0 + 1e-6
    colourless = replace(patches, color=patches.color[..., :0])
    assert torch.equal(patch_input(colourless, "normals_depth"), shape)
    assert sees_color("rgbd") and not sees_color("normals_depth")
    with pytest.raises(ValueError, match="needs patches with colour"):
        patch_input(colourless, "rgbd")


def test_another_kind_is_refused_by_name():
    with pytest.raises(ValueError, match=r"'depth_only'.*rgbd, normals_depth"):
        encoder_input(None, *patch_depth(random_patches()), "depth_only")
