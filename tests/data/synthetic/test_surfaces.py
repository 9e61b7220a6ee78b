import numpy as np
import pytest

from hlp.data.synthetic.layout import light_from_above, look_at, place_targets
from hlp.data.synthetic.objects import demo_objects
from hlp.data.synthetic.surfaces import draw_surroundings, random_surroundings
from hlp.geometry import back_project, inverse, transform

CAMERA = np.array([[280.0, 0, 160.0], [0, 280.0, 120.0], [0, 0, 1.0]])
SHAPE = (240, 320)


@pytest.mark.parametrize("seed", range(4))
def test_every_surface_point_lies_on_table_floor_or_wall(seed: int) -> None:
    rng = np.random.default_rng(seed)
    around = random_surroundings(0.4, rng)
    pose = look_at(np.zeros(3), 0.8, 0.4, np.radians(25 + 15 * seed), 0.1)
    items = place_targets([demo_objects()[1]], 0.0, rng)
    light = light_from_above(pose, rng)
    rgb, depth = draw_surroundings(around, items, pose, CAMERA, SHAPE, light)
    y, x = np.nonzero(depth > 0)
    points = back_project(np.stack([x, y], -1).astype(float), depth[y, x].astype(float), CAMERA)
    world = transform(inverse(pose), points)
    on_wall = np.abs(world @ around.wall_normal + around.wall_distance) < 1e-4
    on_table = np.abs(world[:, 2]) < 1e-4
    on_floor = np.abs(world[:, 2] + 0.72) < 1e-4
    assert (on_wall | on_table | on_floor).all()
    assert on_table.mean() > 0.2
    assert (np.linalg.norm(world[on_table & ~on_wall, :2], axis=1) < np.sqrt(2) + 1e-3).all()
    assert depth[SHAPE[0] // 2, SHAPE[1] // 2] == pytest.approx(0.8, abs=0.01)
    assert rgb[depth > 0].max() > 20


def test_items_darken_the_table_below_them_and_nothing_else() -> None:
    rng = np.random.default_rng(1)
    around = random_surroundings(0.0, rng)
    pose = look_at(np.zeros(3), 0.8, 0.0, np.radians(50), 0.0)
    light = light_from_above(pose, rng)
    item = place_targets([demo_objects()[2]], 0.0, rng)[0]
    far = [item.__class__(**{**vars(item), "pose_world_obj": np.eye(4) + np.eye(4, k=3) * 50})]
    with_item, depth = draw_surroundings(around, [item], pose, CAMERA, SHAPE, light)
    without, same_depth = draw_surroundings(around, far, pose, CAMERA, SHAPE, light)
    np.testing.assert_array_equal(depth, same_depth)
    assert (with_item <= without).all()
    center = transform(pose, np.array([[*item.center, 0.0]]))[0]
    x, y = (center[:2] / center[2] * 280 + [160, 120]).round().astype(int)
    assert with_item[y, x].sum() < 0.85 * without[y, x].sum()
    assert (with_item == without).all(axis=-1).mean() > 0.3
