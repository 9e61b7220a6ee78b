import numpy as np
import pytest

from hlp.objects.random_shapes import random_shape, toy_tree


@pytest.mark.parametrize("seed", range(8))
def test_random_shapes_have_the_stated_size(seed):
    mesh = random_shape(np.random.default_rng(seed), least_height=0.12)
    assert 0.03 < np.ptp(mesh.vertices, axis=0).max() < 0.21
    assert len(mesh.colors) == len(mesh.normals) == len(mesh.vertices)
    assert len(np.unique(mesh.colors, axis=0)) <= 2


def test_a_tree_has_its_crown_at_the_height():
    tree = toy_tree(0.03, 0.2, np.random.default_rng(0))
    widest = np.argmax(np.hypot(*tree.vertices[:, :2].T))
    assert tree.vertices[widest, 2] == pytest.approx(0.2, abs=0.03)
