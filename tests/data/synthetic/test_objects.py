import numpy as np
import pytest
import trimesh
from scipy.spatial import cKDTree

from hlp.data.synthetic.objects import demo_objects, turns_about_z
from hlp.geometry import transform
from hlp.records import ObjectModel

MODELS = {model.name: model for model in demo_objects().values()}
ASYMMETRIC = [name for name in MODELS if name != "bowl"]


def turned_distance(model: ObjectModel, motion: np.ndarray) -> np.ndarray:
    """Distance (m) of every fourth turned vertex to the nearest unturned one."""
    turned = transform(motion, model.mesh.vertices[::4])
    distance, _ = cKDTree(model.mesh.vertices).query(turned)
    return np.asarray(distance)


def test_ids_follow_names_and_objects_are_built_once() -> None:
    objects = demo_objects()
    assert list(objects) == list(range(1, 9))
    assert [m.name for m in objects.values()] == sorted(MODELS)
    assert demo_objects()[1] is objects[1]


@pytest.mark.parametrize("name", MODELS)
def test_sizes_and_meshes_are_like_linemod(name: str) -> None:
    model = MODELS[name]
    assert 0.08 < model.diameter < 0.26
    # The diameter is the largest extent over all directions.
    directions = np.random.default_rng(0).normal(size=(3, 2000))
    directions /= np.linalg.norm(directions, axis=0)
    extent = np.ptp(model.mesh.vertices @ directions, axis=0).max()
    assert 0.995 * model.diameter < extent <= model.diameter + 1e-9
    assert 5000 < len(model.mesh.faces) <= 30000
    assert 1800 <= len(model.proxy.faces) <= 2000
    a, b = model.mesh.vertices[model.mesh.faces[:, 0]], model.mesh.vertices[model.mesh.faces[:, 1]]
    assert np.quantile(np.linalg.norm(a - b, axis=1), 0.95) < 0.006
    np.testing.assert_allclose(model.centroid, 0.0, atol=1e-9)
    assert 2 <= len(np.unique(model.mesh.colors, axis=0)) <= 6
    assert 0.03 <= model.local_size < model.holistic_size <= 0.20


@pytest.mark.parametrize("name", MODELS)
def test_proxy_lies_on_the_mesh(name: str) -> None:
    model = MODELS[name]
    surface = trimesh.Trimesh(model.mesh.vertices, model.mesh.faces, process=False)
    points, _ = trimesh.sample.sample_surface(surface, 200_000, seed=0)
    distance, _ = cKDTree(points).query(model.proxy.vertices)
    assert distance.mean() < 0.0015
    assert distance.max() < 0.007


def test_bowl_is_symmetric_under_every_listed_motion_and_says_so_finely() -> None:
    bowl = MODELS["bowl"]
    np.testing.assert_array_equal(bowl.symmetries[0], np.eye(4))
    for motion in bowl.symmetries[[1, 7, 45, 90, 179]]:
        assert turned_distance(bowl, motion).max() < 1e-9
    assert turned_distance(bowl, turns_about_z(360)[1]).max() > 1e-4  # half way
    steps = np.einsum("nij,nij->n", bowl.symmetries[:-1, :3, :3], bowl.symmetries[1:, :3, :3])
    np.testing.assert_allclose(np.arccos((steps - 1) / 2), np.radians(2), atol=1e-6)


@pytest.mark.parametrize("name", ASYMMETRIC)
def test_other_objects_have_no_rotation_symmetry(name: str) -> None:
    model = MODELS[name]
    assert len(model.symmetries) == 1
    for motion in turns_about_z(12)[1:]:
        assert np.quantile(turned_distance(model, motion), 0.9) > 0.004


def test_bear_and_rabbit_share_most_of_their_surface_but_not_all() -> None:
    def foot_first(model: ObjectModel) -> np.ndarray:
        points = model.mesh.vertices
        return np.asarray(points - [points[:, 0].max(), 0.0, points[:, 2].min()])

    bear, rabbit = foot_first(MODELS["bear"]), foot_first(MODELS["rabbit"])
    distance, _ = cKDTree(rabbit).query(bear)
    assert 0.8 < (distance < 0.001).mean() < 0.99
    assert np.ptp(rabbit[:, 2]) - np.ptp(bear[:, 2]) > 0.03
