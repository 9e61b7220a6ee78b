import dataclasses

import numpy as np
import pytest
import torch

from hlp.models.encoder import NetworkEncoder, PatchEncoder
from hlp.models.encoder_input import patch_input
from hlp.records import LocalPatches


def random_patches(count, seed=0):
    rng = np.random.default_rng(seed)
    return LocalPatches(
        rng.integers(0, 256, (count, 32, 32, 3)).astype(np.uint8),
        rng.uniform(-1, 1, (count, 32, 32)).astype(np.float32),
        rng.random((count, 32, 32)) < 0.9,
        np.zeros((count, 3)),
        np.zeros((count, 2)),
    )


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


@pytest.mark.parametrize(
    ("widths", "dimension"), [((8, 12, 16), 24), ((4,), 10), ((32, 64, 96, 128), 200)]
)
def test_shapes_and_parameter_counts(widths, dimension):
    network = PatchEncoder(widths, dimension)
    assert network(torch.zeros(3, 4, 32, 32)).shape == (3, dimension)
    expected, previous, side = 0, 4, 32
    for width in widths:
        expected += 9 * previous * width + width + 2 * width  # convolution, bias, batch norm
        previous, side = width, side // 2
    expected += previous * side**2 * dimension + dimension
    assert sum(each.numel() for each in network.parameters()) == expected


@pytest.mark.parametrize("kind", ["rgbd", "normals_depth"])
def test_features_are_the_networks_own_but_for_bfloat16(kind):
    patches, network = random_patches(20), trained_network()
    features = NetworkEncoder(network, kind, unit_length=False).encode(patches)
    with torch.no_grad():
        exact = network.eval()(patch_input(patches, kind)).numpy()
    assert features.shape == (20, 24) and features.dtype == np.float32
    error = np.linalg.norm(features - exact, axis=1) / np.linalg.norm(exact, axis=1)
    assert error.max() < 0.03


def test_a_patch_has_one_feature_in_whatever_company():
    patches = random_patches(1100)  # three chunks, the last one smaller
    encoder = NetworkEncoder(trained_network(), "normals_depth", unit_length=True)
    together = encoder.encode(patches)
    for chosen in (slice(0, 1), slice(500, 530), slice(1020, 1100), slice(0, 600)):
        np.testing.assert_array_equal(encoder.encode(rows(patches, chosen)), together[chosen])


def test_unit_length_is_applied_where_asked_for():
    patches, network = random_patches(9), trained_network()
    plain = NetworkEncoder(network, "rgbd", unit_length=False).encode(patches)
    unit = NetworkEncoder(network, "rgbd", unit_length=True).encode(patches)
    norms = np.linalg.norm(plain, axis=1, keepdims=True)
    assert norms.std() > 1e-3
    np.testing.assert_allclose(unit, plain / norms, atol=1e-6)


def test_no_patches_give_no_features():
    encoder = NetworkEncoder(trained_network(), "rgbd", unit_length=True)
    assert encoder.encode(random_patches(0)).shape == (0, 24)
