import numpy as np
import pytest
import torch

from hlp.models.classifier import class_probabilities
from hlp.models.classifier_training import HolisticCNN
from hlp.models.network import load_network
from hlp.models.onnx_export import export_network


def random_levels(count, channels=4, seed=0):
    rng = np.random.default_rng(seed)
    return rng.integers(1, 256, (count, 64, 64, channels)).astype(np.uint8)


def scaled(levels):
    """Levels as training has them: (n, c, 64, 64) in [-1, 1]."""
    images = torch.from_numpy(levels).permute(0, 3, 1, 2).float()
    return torch.cat([images[:, :3] / 127.5 - 1, (images[:, 3:] - 128) / 127], dim=1)


def trained(channels, classes):
    """A network whose batch norms have seen data, as training leaves them."""
    torch.manual_seed(0)
    network = HolisticCNN(channels, classes, (4, 8), 16, 0.5).train()
    for scale in (0.5, 1.0, 2.0):
        network(torch.randn(16, channels, 64, 64) * scale)
    network.head[-1].weight.data *= 10  # so that windows differ
    return network


def exported(network, folder, channels=4):
    sample = scaled(random_levels(256, channels, seed=9))
    export_network(network.layers, sample, folder / "classifier", levels=True)
    return load_network(folder / "classifier", threads=2)


@pytest.mark.parametrize("channels", [3, 4])
def test_probabilities_are_the_softmax_of_each_window(channels, tmp_path):
    network, levels = trained(channels, 3), random_levels(300, channels)  # more than one chunk
    found = class_probabilities(exported(network, tmp_path, channels), levels)
    assert found.shape == (300, 3) and found.dtype == np.float32
    np.testing.assert_allclose(found.sum(axis=1), 1.0, atol=1e-5)
    assert network.training  # left as it was
    with torch.no_grad():
        expected = torch.softmax(network.eval()(scaled(levels)), dim=1).numpy()
    off = np.abs(found - expected)  # 8-bit integers
    assert off.mean() < 0.005 and off.max() < 0.1
    assert np.abs(expected - expected.mean(axis=0)).max() > 0.1


def test_a_window_has_the_same_probabilities_in_whatever_company(tmp_path):
    network, levels = exported(trained(4, 3), tmp_path), random_levels(300)
    together = class_probabilities(network, levels)
    np.testing.assert_array_equal(class_probabilities(network, levels[250:263]), together[250:263])
    np.testing.assert_array_equal(class_probabilities(network, levels), together)


def test_no_windows_have_no_probabilities(tmp_path):
    network = exported(trained(3, 5), tmp_path, channels=3)
    assert class_probabilities(network, random_levels(0, 3)).shape == (0, 5)
