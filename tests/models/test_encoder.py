import numpy as np
import pytest
import torch

from hlp.models.encoder import patch_input
from hlp.models.encoder_training import PatchEncoder
from hlp.models.network_encoders import AutoencoderSettings, ContrastiveSettings
from hlp.models.onnx_export import export_network
from hlp.patches.local import take_patches
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
    export_network(network.layers, sample, folder / "encoder", levels=False)
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
        np.testing.assert_array_equal(made.encode(take_patches(patches, rows)), together[rows])
