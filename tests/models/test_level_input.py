import pytest
import torch
from torch import nn

from hlp.models.onnx_export import levels_layer, side_by_side, to_levels


def random_images(channels):
    """Images (n, c, 64, 64) whose every value is a level."""
    gen = torch.Generator().manual_seed(0)
    levels = torch.randint(1, 256, (3, channels, 64, 64), generator=gen).float()
    return torch.cat([levels[:, :3] / 127.5 - 1, (levels[:, 3:] - 128) / 127], dim=1)


@pytest.mark.parametrize("channels", [3, 4])
def test_a_layer_over_levels_is_the_convolution(channels):
    torch.manual_seed(0)
    layer = nn.Conv2d(channels, 6, 5, stride=2, padding=2)
    images = random_images(channels)
    with torch.no_grad():
        expected = layer(images)
        found = levels_layer(layer)(side_by_side(to_levels(images)))
    assert found.shape == expected.shape
    torch.testing.assert_close(found[..., 1:-1, 1:-1], expected[..., 1:-1, 1:-1])
    # Half a level about the image, times what the weights there may be in sum.
    half = layer.weight[:, :3].abs().sum(dim=(1, 2, 3)).max().item() * 0.5 / 127.5
    assert (found - expected).abs().max() < half


def test_pixels_lie_side_by_side():
    images = random_images(4)
    blocks = side_by_side(images)
    assert blocks.shape == (3, 16, 32, 32)
    for row in (0, 1):
        for column in (0, 1):
            first = 4 * (2 * row + column)
            expected = images[:, :, row::2, column::2]
            assert torch.equal(blocks[:, first : first + 4], expected)


@pytest.mark.parametrize(
    "layer",
    [nn.Conv2d(4, 6, 3, stride=2, padding=1), nn.Conv2d(4, 6, 5, padding=2), nn.Linear(4, 6)],
)
def test_another_first_layer_is_refused(layer):
    with pytest.raises(ValueError, match="5 × 5 convolution of stride 2"):
        levels_layer(layer)
