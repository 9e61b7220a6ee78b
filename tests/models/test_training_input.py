import numpy as np
import pytest
import torch

from hlp.models.contrastive_training import encoder_input
from hlp.models.encoder import patch_input
from hlp.records import LocalPatches


@pytest.mark.parametrize("kind", ["rgbd", "normals_depth"])
def test_training_sees_patches_as_detection_does(kind):
    rng = np.random.default_rng(1)
    color = rng.integers(0, 256, (5, 32, 32, 3)).astype(np.uint8)
    depth = rng.uniform(-1, 1, (5, 32, 32)).astype(np.float32)
    valid = rng.random((5, 32, 32)) < 0.9
    patches = LocalPatches(color, depth, valid, np.zeros((5, 3)), np.zeros((5, 2)))
    levels = torch.from_numpy(color).permute(0, 3, 1, 2) / 255.0
    found = encoder_input(levels, torch.from_numpy(depth), torch.from_numpy(valid), kind)
    assert found.shape == (5, 4, 32, 32)
    expected = patch_input(patches, kind).transpose(0, 3, 1, 2)
    np.testing.assert_allclose(found.numpy(), expected, atol=1e-6)


def test_missing_colour_and_another_kind_are_refused():
    depth, valid = torch.zeros((2, 32, 32)), torch.ones((2, 32, 32), dtype=torch.bool)
    with pytest.raises(ValueError, match="needs patches with colour"):
        encoder_input(None, depth, valid, "rgbd")
    with pytest.raises(ValueError, match=r"'depth_only'.*rgbd, normals_depth"):
        encoder_input(None, depth, valid, "depth_only")
