import numpy as np
import pytest
import trimesh
from scipy.spatial import cKDTree

from hlp.data.synthetic.bins import BinScenes, BinSettings, bin_parts
from hlp.data.synthetic.layout import Item
from hlp.data.synthetic.scenes import Scene, SyntheticScenes
from hlp.geometry import transform
from hlp.records import ObjectModel
from hlp.rendering.rasterizer import render_depth

FLOOR, HALF_A_WALL = 0.004, 0.002
NEAR = 0.002  # m: a cell of the map of heights by which parts are laid


@pytest.fixture(scope="module")
def source() -> BinScenes:
    return BinScenes(BinSettings(scenes=2, width=320, noise=0.0))


def parts_of(scene: Scene) -> list[Item]:
    return [item for item in scene.items if item.object_id]


def points_of(item: Item, count: int = 120) -> np.ndarray:
    """Points on an item's surface in the world."""
    surface = trimesh.Trimesh(item.mesh.vertices, item.mesh.faces, process=False)
    points, _ = trimesh.sample.sample_surface(surface, count, seed=0)
    return transform(item.pose_world_obj, points)


def depth_inside(points: np.ndarray, item: Item) -> float:
    """How deep (m) the deepest of the points is in an item, by its winding numbers."""
    corners = transform(item.pose_world_obj, item.mesh.vertices)[item.mesh.faces]
    a, b, c = (corners[:, i] - points[:, None] for i in range(3))
    la, lb, lc = (np.linalg.norm(side, axis=-1) for side in (a, b, c))
    volume = np.einsum("pfi,pfi->pf", a, np.cross(b, c))
    flat = la * lb * lc + (a * b).sum(-1) * lc + (b * c).sum(-1) * la + (c * a).sum(-1) * lb
    inside = np.arctan2(volume, flat).sum(axis=1) / (2 * np.pi) > 0.5
    if not inside.any():
        return 0.0
    return float(cKDTree(points_of(item, 20_000)).query(points[inside])[0].max())


@pytest.mark.parametrize("model", bin_parts().values(), ids=lambda model: model.name)
def test_parts_are_flat_and_have_no_colours_and_no_symmetry(model: ObjectModel) -> None:
    sides = np.ptp(model.mesh.vertices, axis=0)
    assert 0.012 <= sides[2] <= 0.020 and 0.06 < model.diameter < 0.12
    assert not model.mesh.colored and len(np.unique(model.mesh.colors, axis=0)) == 1
    assert len(model.symmetries) == 1
    np.testing.assert_allclose(np.linalg.norm(model.mesh.normals, axis=1), 1.0)
    for turn in (np.diag([-1, -1, 1]), np.diag([1, -1, -1]), np.diag([-1, 1, -1])):
        distance, _ = cKDTree(model.mesh.vertices).query(model.mesh.vertices @ turn)
        assert np.quantile(distance, 0.9) > 0.004


def test_parts_lie_in_the_bin_and_hardly_in_each_other(source: BinScenes) -> None:
    flat = []
    for key in source.keys:
        items = source.scene(key).items
        parts, walls = parts_of(source.scene(key)), items[-5:-1]
        assert len(parts) >= 4
        centers = np.stack([wall.center for wall in walls])
        low, high = centers.min(axis=0) + HALF_A_WALL, centers.max(axis=0) - HALF_A_WALL
        for number, part in enumerate(parts):
            points = points_of(part)
            assert (points[:, :2] > low - NEAR).all() and (points[:, :2] < high + NEAR).all()
            assert points[:, 2].min() > FLOOR - NEAR
            flat.append(np.abs(part.pose_world_obj[2, 2]) > np.cos(np.radians(3.0)))
            near = [o for o in parts[:number] if np.linalg.norm(o.center - part.center) < 0.1]
            for other in near:
                assert depth_inside(points, other) < NEAR
                assert depth_inside(points_of(other), part) < NEAR
    assert 0.2 < np.mean(flat) < 0.9  # on a face, and across others


def test_instances_of_one_object_have_poses_and_masks_of_their_own(source: BinScenes) -> None:
    frame = source.load(source.keys[1])
    depth = source.scene(frame.key).depth
    objects = [target.object_id for target in frame.targets]
    assert objects == sorted(objects) and len(objects) > len({*objects})
    for target in frame.targets:
        mask = source.visible_mask(frame, target)
        mesh, camera = bin_parts()[target.object_id].mesh, frame.camera_matrix
        alone = render_depth(mesh, target.pose_cam_obj[None], camera, depth.shape)[0]
        np.testing.assert_allclose(depth[mask], alone[mask], atol=1e-5)
        assert mask.sum() == pytest.approx(target.visible_fraction * (alone > 0).sum(), rel=0.02)


def test_all_instances_of_a_frame_are_looked_for() -> None:
    dataset = BinSettings(scenes=2, width=320).build()
    frame = dataset.frames.load(dataset.frames.keys[0])
    wanted = dataset.instances_to_find(frame)
    assert sum(wanted.values()) == len(frame.targets) and max(wanted.values()) > 1
    background = dataset.background_frames
    assert isinstance(background, SyntheticScenes) and not isinstance(background, BinScenes)


def test_paint_differs_between_scenes_and_not_within_one(source: BinScenes) -> None:
    paints = [
        {tuple(item.mesh.colors[0]) for item in parts_of(source.scene(key))} for key in source.keys
    ]
    assert all(len(paint) == 1 for paint in paints)
    assert len(set.union(*paints)) == len(paints)


def test_identity_is_not_the_demos() -> None:
    first, other = BinScenes(BinSettings()), BinScenes(BinSettings(seed=1))
    assert first.identity() != other.identity()
    assert first.identity() == BinScenes(BinSettings()).identity()
