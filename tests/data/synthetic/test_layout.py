import numpy as np
import pytest
from scipy.spatial import cKDTree

from hlp.data.synthetic import layout
from hlp.data.synthetic.objects import demo_objects
from hlp.geometry import transform


def some_items(seed: int) -> list[layout.Item]:
    rng = np.random.default_rng(seed)
    items = layout.place_targets(list(demo_objects().values()), np.radians(5.0), rng)
    return items + layout.place_clutter(8, items, np.array([0.5, 0.2, 0.6]), rng)


def points_of(item: layout.Item) -> np.ndarray:
    return transform(item.pose_world_obj, item.mesh.vertices)


def test_nothing_touches_and_everything_stands_on_the_table() -> None:
    items = some_items(0)
    points = [points_of(item) for item in items]
    for item, own in zip(items, points, strict=True):
        assert own[:, 2].min() == pytest.approx(0.0, abs=1e-9)
        reach = np.linalg.norm(own[:, :2] - item.center, axis=1).max()
        assert reach == pytest.approx(item.radius, abs=1e-9)
    for i in range(len(items)):
        tree = cKDTree(points[i])
        for j in range(i):
            assert tree.query(points[j])[0].min() >= layout.GAP - 1e-9


def test_targets_stand_upright_and_lean_no_further_than_asked() -> None:
    lean = [
        np.degrees(np.arccos(min(item.pose_world_obj[2, 2], 1.0)))
        for seed in range(4)
        for item in some_items(seed)
        if item.object_id
    ]
    assert 2.5 < max(lean) <= 5.0 + 1e-6


def test_occluders_stand_between_targets_and_the_eye() -> None:
    rng = np.random.default_rng(3)
    target = layout.place_targets([demo_objects()[6]], 0.0, rng)
    eye = np.array([0.7, 0.0, 0.5])
    first, second, third = layout.place_clutter(3, target, eye, rng)
    sight = eye - target[0].pose_world_obj[:3, 3]
    for item in (first, second):
        assert item.center[0] > target[0].center[0]
    # The line of sight to the target's middle meets the tree's crown, give or take.
    share = (second.center[0] - target[0].center[0]) / sight[0]
    height = target[0].pose_world_obj[2, 3] + share * sight[2]
    assert height - 0.06 < points_of(second)[:, 2].max() < height + 0.15
    assert third.object_id == 0


@pytest.mark.parametrize("roll", [0.0, 0.3])
def test_look_at_puts_the_target_on_the_axis_at_its_distance(roll: float) -> None:
    target = np.array([0.1, -0.2, 0.05])
    pose = layout.look_at(target, 0.8, azimuth=0.7, elevation=np.radians(40), roll=roll)
    np.testing.assert_allclose(transform(pose, target[None])[0], [0, 0, 0.8], atol=1e-12)
    np.testing.assert_allclose(pose[:3, :3] @ pose[:3, :3].T, np.eye(3), atol=1e-12)
    assert np.linalg.det(pose[:3, :3]) == pytest.approx(1.0)
    eye = -pose[:3, :3].T @ pose[:3, 3]
    assert eye[2] - target[2] == pytest.approx(0.8 * np.sin(np.radians(40)))
    # Rolled by that much: the world's vertical is a column of the image, turned.
    vertical = pose[:2, :3] @ [0, 0, 1]
    assert np.abs(np.arctan2(vertical[0], -vertical[1])) == pytest.approx(roll)


def test_light_comes_from_above_and_from_the_camera_side() -> None:
    rng = np.random.default_rng(0)
    pose = layout.look_at(np.zeros(3), 0.8, 0.3, np.radians(25), 0.1)
    for _ in range(20):
        direction = np.array(layout.light_from_above(pose, rng).direction)
        assert np.linalg.norm(direction) == pytest.approx(1.0)
        assert direction[2] < 0
        assert (pose[:3, :3].T @ direction)[2] > np.sin(np.radians(25))
