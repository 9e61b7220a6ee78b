from dataclasses import replace

import numpy as np
import pytest

from hlp.data.synthetic.objects import demo_objects
from hlp.objects import distractors
from hlp.objects.distractors import distractor_scenes


@pytest.fixture(scope="module", autouse=True)
def few_shapes():
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(distractors, "_SHAPES", 12)
        yield


@pytest.fixture(scope="module")
def mesh():
    return demo_objects()[1].mesh


@pytest.fixture(scope="module")
def scenes(mesh):
    return distractor_scenes([mesh], 4, 0, threads=1)


def test_scenes_do_not_depend_on_threads(mesh, scenes):
    again = distractor_scenes([mesh], 4, 0, threads=3)
    for one, other in zip(scenes, again, strict=True):
        np.testing.assert_array_equal(one.rgb, other.rgb)
        np.testing.assert_array_equal(one.depth, other.depth)
    other = distractor_scenes([mesh], 1, 1, threads=1)[0]
    assert (other.depth != scenes[0].depth).any()


def test_scenes_show_things_before_a_plane(scenes):
    for frame in scenes:
        seen = frame.depth > 0
        assert seen.mean() > 0.9
        assert frame.depth[seen].min() > 0.1 and np.median(frame.depth[seen]) < 2.5
        assert not frame.targets
        # Steps in depth between neighbours: things stand out of the plane.
        both = seen[:, 1:] & seen[:, :-1]
        assert (np.abs(np.diff(frame.depth, axis=1))[both] > 0.02).sum() > 50


def test_things_wear_the_objects_colors(mesh):
    colors = np.tile(np.uint8([250, 3, 7]), (len(mesh.vertices), 1))
    painted, _ = distractors._unit_size(replace(mesh, colors=colors))
    shape = distractors._random_thing(np.random.default_rng(0))
    worn = [distractors._paint(shape, painted, np.random.default_rng(seed)) for seed in range(24)]
    alike = [np.abs(item.astype(int) - [250, 3, 7]).max() <= 1 for item in worn]
    assert 0.25 < np.mean(alike) < 0.75
    assert all(item.shape == shape.colors.shape for item in worn)


def test_no_scene_if_none_is_wanted(mesh):
    assert distractor_scenes([mesh], 0, 0, threads=1) == []


@pytest.mark.parametrize("seed", range(8))
def test_random_shapes_have_the_stated_size(seed):
    mesh = distractors.random_shape(np.random.default_rng(seed), least_height=0.12)
    assert 0.03 < np.ptp(mesh.vertices, axis=0).max() < 0.21
    assert len(mesh.colors) == len(mesh.normals) == len(mesh.vertices)
    assert len(np.unique(mesh.colors, axis=0)) <= 2


def test_a_tree_has_its_crown_at_the_height():
    tree = distractors.toy_tree(0.03, 0.2, np.random.default_rng(0))
    widest = np.argmax(np.hypot(*tree.vertices[:, :2].T))
    assert tree.vertices[widest, 2] == pytest.approx(0.2, abs=0.03)
