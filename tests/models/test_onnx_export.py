import numpy as np
import pytest
import torch
from torch import nn

from hlp.models.network import SINGLE, Network
from hlp.models.network_training import PatchEncoder
from hlp.models.onnx_export import export_network, levels_layer, side_by_side, to_levels
from networks import random_levels, scaled, trained


def trained_encoder():
    torch.manual_seed(0)
    return trained(PatchEncoder((8, 12, 16), 24), 32)


def unit_images(count, seed):
    gen = torch.Generator().manual_seed(seed)
    return torch.rand((count, 4, 32, 32), generator=gen) * 2 - 1


@pytest.fixture(scope="module")
def exported(tmp_path_factory):
    network, stem = trained_encoder(), tmp_path_factory.mktemp("onnx") / "encoder"
    export_network(network, unit_images(128, seed=1), stem, levels=False)
    return stem, network


def outputs(path, images):
    """What a network in a file makes of images (n, c, h, w)."""
    return Network(path, 1).run(images.permute(0, 2, 3, 1).contiguous().numpy())


def test_single_precision_is_the_network(exported):
    """How near integers come is tested beside the encoders and the classifier."""
    (stem, network), images = exported, unit_images(40, seed=2)
    found = outputs(stem.with_name(stem.name + SINGLE), images)
    with torch.no_grad():
        np.testing.assert_allclose(found, network.eval()(images), atol=1e-5)


def test_the_same_network_gives_the_same_files(exported, tmp_path):
    stem, _ = exported
    network = trained_encoder()
    export_network(network, unit_images(128, seed=1), tmp_path / "encoder", levels=False)
    for path in tmp_path.iterdir():
        assert path.read_bytes() == stem.with_name(path.name).read_bytes()
    assert network.training  # left as it was


@pytest.mark.parametrize("weight", [0.0, 1e-12, 1e-8, 1e-3])
def test_a_channel_of_small_weights_keeps_its_bias(tmp_path, weight):
    """As batch norm leaves it where it has switched a channel off."""
    torch.manual_seed(0)
    first = nn.Conv2d(4, 2, 3, stride=2, padding=1)
    layers = [first, nn.LeakyReLU(0.1), nn.Flatten(), nn.Linear(2 * 16 * 16, 3)]
    with torch.no_grad():
        first.weight[1] = weight
        first.bias[:] = torch.tensor([0.1, 3.0])
        layers[3].weight[1] = weight
        layers[3].bias[1] = -2.0
    export_network(layers, unit_images(64, seed=1), tmp_path / "net", levels=False)
    images = unit_images(10, seed=2)
    with torch.no_grad():
        expected = nn.Sequential(*layers)(images).numpy()
    found = outputs(tmp_path / "net.int8.onnx", images)
    np.testing.assert_allclose(found, expected, atol=0.05)


def test_an_unknown_layer_is_named(tmp_path):
    layers = [nn.Conv2d(4, 8, 3), nn.GELU(), nn.Flatten(), nn.Linear(8 * 30 * 30, 5)]
    with pytest.raises(TypeError, match="GELU"):
        export_network(layers, unit_images(2, seed=0), tmp_path / "other", levels=False)


@pytest.mark.parametrize("channels", [3, 4])
def test_a_layer_over_levels_is_the_convolution(channels):
    torch.manual_seed(0)
    layer = nn.Conv2d(channels, 6, 5, stride=2, padding=2)
    images = scaled(random_levels(3, channels))
    with torch.no_grad():
        expected = layer(images)
        found = levels_layer(layer)(side_by_side(to_levels(images)))
    assert found.shape == expected.shape
    torch.testing.assert_close(found[..., 1:-1, 1:-1], expected[..., 1:-1, 1:-1])
    # Half a level about the image, times what the weights there may be in sum.
    half = layer.weight[:, :3].abs().sum(dim=(1, 2, 3)).max().item() * 0.5 / 127.5
    assert (found - expected).abs().max() < half


@pytest.mark.parametrize(
    "layer",
    [nn.Conv2d(4, 6, 3, stride=2, padding=1), nn.Conv2d(4, 6, 5, padding=2), nn.Linear(4, 6)],
)
def test_another_first_layer_is_refused(layer):
    with pytest.raises(ValueError, match="5 × 5 convolution of stride 2"):
        levels_layer(layer)
