from dataclasses import replace

import numpy as np
import pytest
import torch
from torch.nn import functional

from hlp.models.encoder import normals_with_depth
from hlp.models.pca import PcaSettings, fit_pca
from view_records import random_patches

CELLS = 4


def make_patches(count, seed=0):
    gen = torch.Generator().manual_seed(seed)
    coarse = torch.randn((count, 1, 5, 5), generator=gen)
    depth = functional.interpolate(coarse, (32, 32), mode="bilinear")[:, 0] * 0.3
    valid = torch.rand((count, 32, 32), generator=gen) < 0.95
    return replace(random_patches(count), depth=depth.numpy(), valid=valid.numpy())


def averaged(patches):
    """Normals averaged over cells, cell by cell."""
    normals = normals_with_depth(patches.depth, patches.valid)[..., :3]
    cells = normals.reshape(len(patches), CELLS, 8, CELLS, 8, 3).mean(axis=(2, 4))
    return cells.transpose(0, 3, 1, 2).reshape(len(patches), -1).astype(np.float64)


def fitted(patches, dimension):
    settings = PcaSettings("pca", dimension, CELLS)
    return fit_pca(patches.depth, patches.valid, settings)


def test_components_equal_those_of_the_singular_value_decomposition():
    patches = make_patches(200)
    pca = fitted(patches, 10)
    data = averaged(patches)
    _, _, vt = np.linalg.svd(data - data.mean(axis=0), full_matrices=False)
    np.testing.assert_allclose(pca.mean, data.mean(axis=0), atol=1e-5)
    overlap = np.abs(np.einsum("df,df->d", pca.components, vt[:10]))  # signs are free
    np.testing.assert_allclose(overlap, 1.0, atol=1e-3)


def test_features_are_projections():
    patches, others = make_patches(200), make_patches(30, seed=1)
    pca = fitted(patches, 48)
    features = pca.encode(others)
    assert features.shape == (30, 48) and features.dtype == np.float32
    data = averaged(others)
    expected = (data - averaged(patches).mean(axis=0)) @ pca.components.T
    np.testing.assert_allclose(features, expected, atol=1e-4)


def test_no_more_components_than_there_are_values_and_none_of_nothing():
    with pytest.raises(ValueError, match=r"^dimension is 49: 4 × 4 normals have 48 components$"):
        fitted(make_patches(60), 49)
    pca = fitted(make_patches(60), 48)
    assert pca.components.shape == (48, 48)
    assert pca.encode(make_patches(0)).shape == (0, 48)


@pytest.mark.parametrize("cells", [5, 12])
def test_cells_that_do_not_divide_a_patch_overlap_as_torchs(cells):
    """Adaptive average pooling, which features were made with before."""
    patches = make_patches(20)
    settings = PcaSettings("pca", 3 * cells * cells, cells)
    normals = normals_with_depth(patches.depth, patches.valid)[..., :3].transpose(0, 3, 1, 2)
    pooled = functional.adaptive_avg_pool2d(torch.from_numpy(normals.copy()), cells).flatten(1)
    found = fit_pca(patches.depth, patches.valid, settings).mean
    np.testing.assert_allclose(found, pooled.mean(dim=0).numpy(), atol=1e-5)
