import numpy as np
import pytest
import torch

from hlp.models.classifier import class_probabilities
from hlp.models.network import load_network
from hlp.models.network_training import HolisticCNN
from hlp.models.onnx_export import export_network
from networks import random_levels, scaled, trained


@pytest.mark.parametrize("channels", [3, 4])
def test_probabilities_are_the_softmax_of_each_window_in_whatever_company(channels, tmp_path):
    torch.manual_seed(0)
    network = trained(HolisticCNN(channels, 3, (4, 8), 16, 0.5), 64, channels)
    network.head[-1].weight.data *= 10  # so that windows differ
    sample = scaled(random_levels(256, channels, seed=9))
    export_network(network, sample, tmp_path / "classifier", levels=True)
    loaded = load_network(tmp_path / "classifier", threads=2)
    levels = random_levels(300, channels)
    found = class_probabilities(loaded, levels)
    assert found.shape == (300, 3) and found.dtype == np.float32
    np.testing.assert_allclose(found.sum(axis=1), 1.0, atol=1e-5)
    assert network.training  # left as it was
    with torch.no_grad():
        expected = torch.softmax(network.eval()(scaled(levels)), dim=1).numpy()
    off = np.abs(found - expected)  # 8-bit integers
    assert off.mean() < 0.005 and off.max() < 0.1
    assert np.abs(expected - expected.mean(axis=0)).max() > 0.1
    np.testing.assert_array_equal(class_probabilities(loaded, levels[250:263]), found[250:263])
    assert class_probabilities(loaded, levels[:0]).shape == (0, 3)
