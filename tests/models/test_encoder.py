import dataclasses

import numpy as np
import pytest
import torch

from hlp.models.encoder import NetworkEncoder, patch_input
from hlp.models.encoder_training import PatchEncoder
from hlp.models.network import load_network
from hlp.models.onnx_export import export_network
from hlp.records import LocalPatches
from view_records import random_patches


def rows(patches, chosen):
    fields = [field.name for field in dataclasses.fields(patches)]
    return LocalPatches(*(getattr(patches, name)[chosen] for name in fields))


def trained_network(dimension=24):
    """As after training: batch norm has statistics of its own."""
    torch.manual_seed(0)
    network = PatchEncoder((8, 12, 16), dimension)
    network.train()
    for _ in range(3):
        network(torch.rand(16, 4, 32, 32) * 2 - 1)
    return network


def encoder(folder, kind, unit_length):
    """An encoder as detection loads it, and the network that was trained."""
    network = trained_network()
    sample = torch.from_numpy(patch_input(random_patches(64, seed=9), kind)).permute(0, 3, 1, 2)
    export_network(network.layers, sample, folder / "encoder", levels=False)
    loaded = load_network(folder / "encoder", threads=2)
    return NetworkEncoder(loaded, kind, unit_length), network


@pytest.mark.parametrize("kind", ["rgbd", "normals_depth"])
def test_features_are_the_networks_own_but_for_rounding(kind, tmp_path):
    patches = random_patches(20)
    made, network = encoder(tmp_path, kind, unit_length=False)
    features = made.encode(patches)
    with torch.no_grad():
        images = torch.from_numpy(patch_input(patches, kind)).permute(0, 3, 1, 2)
        exact = network.eval()(images).numpy()
    assert features.shape == (20, 24) and features.dtype == np.float32
    error = np.linalg.norm(features - exact, axis=1) / np.linalg.norm(exact, axis=1)
    assert error.max() < 0.05


def test_a_patch_has_one_feature_in_whatever_company(tmp_path):
    patches = random_patches(1100)  # three chunks, the last one smaller
    made, _ = encoder(tmp_path, "normals_depth", unit_length=True)
    together = made.encode(patches)
    for chosen in (slice(0, 1), slice(500, 530), slice(1020, 1100), slice(0, 600)):
        np.testing.assert_array_equal(made.encode(rows(patches, chosen)), together[chosen])


def test_unit_length_is_applied_where_asked_for(tmp_path):
    patches = random_patches(9)
    plain = encoder(tmp_path, "rgbd", unit_length=False)[0].encode(patches)
    unit = encoder(tmp_path, "rgbd", unit_length=True)[0].encode(patches)
    norms = np.linalg.norm(plain, axis=1, keepdims=True)
    assert norms.std() > 1e-3
    np.testing.assert_allclose(unit, plain / norms, atol=1e-6)


def test_no_patches_give_no_features(tmp_path):
    made, _ = encoder(tmp_path, "rgbd", unit_length=True)
    assert made.encode(random_patches(0)).shape == (0, 24)
