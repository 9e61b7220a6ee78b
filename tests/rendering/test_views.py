"""Views hold the whole object, at the poses they state; viewpoints are spread as well as can be."""

import dataclasses

import numpy as np
import pytest
import trimesh

from hlp.geometry import project, transform
from hlp.rendering import opengl
from hlp.rendering.views import (
    ViewsSettings,
    hemisphere,
    load_views,
    render_views,
    save_views,
    thomson,
    view_rotations,
)
from refinement_scene import model_of

SETTINGS = ViewsSettings(
    name="numba",
    viewpoints=6,
    coverage="hemisphere",
    in_plane_min_deg=-30.0,
    in_plane_max_deg=30.0,
    in_plane_steps=3,
    distance_mm=800.0,
    focal_px=572.0,
    size_px=64,
)


def cone(scale=1.0):
    """A cone far from the origin of its coordinates, tip up."""
    shape = trimesh.creation.cone(radius=0.03 * scale, height=0.06 * scale)
    shape.apply_translation([0.3, -0.2, 0.1])
    return model_of(shape, (200, 100, 50), "thing")


def test_poses_put_the_centroid_on_the_axis_and_cover_the_viewpoints():
    model = cone()
    rendered = render_views(model, SETTINGS, seed=4)
    assert len(rendered) == 18 and rendered.object_id == 1
    centroid = transform(rendered.poses_cam_obj, model.centroid[None])[:, 0]
    np.testing.assert_allclose(centroid, [[0.0, 0.0, 0.8]] * 18, atol=1e-12)
    np.testing.assert_allclose(project(centroid, rendered.camera_matrix), 31.5)
    from_object = rendered.poses_cam_obj[::3, :3, :3].swapaxes(1, 2) @ [0, 0, -1]
    np.testing.assert_allclose(from_object, hemisphere(6, seed=4), atol=1e-12)
    # In-plane angles -30, 0, 30 degrees: the upright one shows the tip above the centre.
    tip = transform(rendered.poses_cam_obj, model.centroid[None] + [0, 0, 0.03])[:, 0]
    angles = np.rad2deg(np.arctan2(tip[:, 0], -tip[:, 1])).reshape(6, 3)
    np.testing.assert_allclose(angles, [[-30.0, 0.0, 30.0]] * 6, atol=1e-9)


def test_pictures_are_of_the_stated_pose_and_the_tip_is_up():
    model = cone()
    rendered = render_views(model, SETTINGS, seed=0)
    assert rendered.rgb.dtype == np.uint8 and rendered.depth.dtype == np.float32
    for rgb, depth, pose in zip(rendered.rgb, rendered.depth, rendered.poses_cam_obj, strict=True):
        seen = depth > 0
        pixels = project(transform(pose, model.mesh.vertices), rendered.camera_matrix)
        rows, columns = np.nonzero(seen)
        drawn = np.array([columns.min(), rows.min(), columns.max(), rows.max()])
        outline = np.concatenate([np.ceil(pixels.min(axis=0)), np.floor(pixels.max(axis=0))])
        assert np.abs(drawn - outline).max() <= 2  # a tip may fall between pixel centres
        assert (rgb[~seen] == 0).all()
        assert (rgb[seen].max(axis=1) > 0).all()
        red, green, blue = rgb[seen].astype(float).mean(axis=0)
        assert red > green > blue
        assert abs(depth[seen].mean() - 0.8) < 0.05


@pytest.mark.parametrize("scale", [0.5, 2.0, 5.0])
def test_the_object_always_fits(scale):
    model = cone(scale)
    rendered = render_views(model, SETTINGS, seed=0)
    for border in (np.s_[:, 0], np.s_[:, -1], np.s_[:, :, 0], np.s_[:, :, -1]):
        assert not rendered.depth[border].any()
    assert rendered.camera_matrix[0, 0] <= SETTINGS.focal_px
    if scale == 0.5:
        assert rendered.camera_matrix[0, 0] == SETTINGS.focal_px
    if scale == 5.0:  # a smaller focal length, but not smaller than it must be
        rows = np.nonzero(rendered.depth.any(axis=(0, 2)))[0]
        assert np.ptp(rows) > 0.75 * SETTINGS.size_px


def test_light_differs_from_view_to_view():
    one_pose = dataclasses.replace(
        SETTINGS, viewpoints=1, in_plane_min_deg=0.0, in_plane_max_deg=0.0, in_plane_steps=4
    )
    rendered = render_views(cone(), one_pose, seed=0)
    for other in range(1, 4):
        np.testing.assert_array_equal(rendered.depth[0], rendered.depth[other])
        assert (rendered.rgb[0] != rendered.rgb[other]).any()


def test_threads_change_nothing_and_the_seed_does():
    alone = render_views(cone(), SETTINGS, seed=0)
    shared = render_views(cone(), SETTINGS, seed=0, threads=3)
    np.testing.assert_array_equal(alone.rgb, shared.rgb)
    np.testing.assert_array_equal(alone.depth, shared.depth)
    other = render_views(cone(), SETTINGS, seed=1, threads=3)
    assert not np.allclose(alone.poses_cam_obj, other.poses_cam_obj)


def test_pyrender_gives_the_same_views():
    problem = opengl.opengl_problem()
    if problem is not None:
        pytest.skip(problem)
    by_numba = render_views(cone(), SETTINGS, seed=0)
    # More threads than one must do no harm: OpenGL stays in this one.
    settings = dataclasses.replace(SETTINGS, name="pyrender")
    by_opengl = render_views(cone(), settings, seed=0, threads=2)
    assert np.mean(np.abs(by_numba.depth - by_opengl.depth) < 1e-5) >= 0.999
    assert np.mean(np.abs(by_numba.rgb.astype(int) - by_opengl.rgb) <= 1) >= 0.999


def test_sphere_coverage_looks_from_below_too():
    settings = dataclasses.replace(SETTINGS, coverage="sphere")
    poses = render_views(cone(), settings, seed=0).poses_cam_obj
    assert (poses[:, 2, 2] > 0.3).any() and (poses[:, 2, 2] < -0.3).any()


def test_a_range_of_angles_that_is_none_is_refused():
    with pytest.raises(ValueError, match=r"^in_plane_max_deg is "):
        dataclasses.replace(SETTINGS, in_plane_max_deg=-40.0)


def test_a_camera_inside_the_object_is_refused():
    settings = dataclasses.replace(SETTINGS, distance_mm=30.0)
    with pytest.raises(ValueError, match=r"rendering\.distance_mm.*thing"):
        render_views(cone(), settings, seed=0)


@pytest.fixture
def few_views():
    return render_views(cone(), SETTINGS, seed=0)


def test_files_bring_the_views_back(tmp_path, few_views):
    save_views(tmp_path / "new" / "folder", few_views)
    loaded = load_views(tmp_path / "new" / "folder", object_id=3)
    assert loaded.object_id == 3  # objects of any id can share the views of a mesh
    np.testing.assert_array_equal(loaded.rgb, few_views.rgb)
    depth = loaded.depth[:]
    np.testing.assert_allclose(depth, few_views.depth, atol=0.0000501)
    np.testing.assert_array_equal(depth == 0, few_views.depth == 0)
    assert depth.dtype == np.float32 and loaded.depth.shape == depth.shape
    np.testing.assert_array_equal(loaded.poses_cam_obj, few_views.poses_cam_obj)
    np.testing.assert_array_equal(loaded.camera_matrix, few_views.camera_matrix)
    assert not loaded.rgb.flags.owndata and not loaded.rgb.flags.writeable  # still on disk


def test_depth_that_does_not_fit_the_files_is_refused(tmp_path, few_views):
    far = dataclasses.replace(few_views, depth=few_views.depth + 6.0)
    with pytest.raises(ValueError, match=r"6\.5535"):
        save_views(tmp_path, far)


def test_missing_and_damaged_files_are_named(tmp_path, few_views):
    save_views(tmp_path, few_views)
    whole = (tmp_path / "depth.npy").read_bytes()
    for kept in (len(whole) // 2, 20, 0):
        (tmp_path / "depth.npy").write_bytes(whole[:kept])
        with pytest.raises(ValueError, match=r"depth\.npy is damaged"):
            load_views(tmp_path, 7)
    (tmp_path / "depth.npy").unlink()
    with pytest.raises(FileNotFoundError, match=r"depth\.npy"):
        load_views(tmp_path, 7)
    np.save(tmp_path / "depth.npy", np.zeros((3, 64, 64), np.uint16))
    with pytest.raises(ValueError, match="18 colour, 3 depth"):
        load_views(tmp_path, 7)


# Lowest known energies: Wales & Ulker, Physical Review B 74 (2006), 212101.
BEST_ENERGY = {2: 0.5, 4: 3.674234614, 12: 49.165253058, 32: 412.261274651}


def coulomb_energy(points):
    """Electrostatic energy Σ_{i<j} 1/|p_i − p_j| of unit charges at `points` (n, 3)."""
    distance = np.linalg.norm(points[:, None] - points[None], axis=-1)
    return float((1.0 / distance[np.triu_indices(len(points), k=1)]).sum())


@pytest.mark.parametrize("count", BEST_ENERGY)
def test_thomson_reaches_the_known_optimum(count):
    points = thomson(count, seed=3)
    assert points.shape == (count, 3)
    np.testing.assert_allclose(np.linalg.norm(points, axis=1), 1.0, atol=1e-12)
    best = BEST_ENERGY[count]
    assert best * (1 - 1e-8) <= coulomb_energy(points) <= best * 1.005


@pytest.mark.parametrize("count", [1, 2, 10, 100])
def test_hemisphere_is_the_upper_half_of_an_even_sphere(count):
    upper = hemisphere(count, seed=1)
    assert upper.shape == (count, 3)
    assert (upper[:, 2] > 0).all()
    whole = np.concatenate([upper, upper * [1, 1, -1]])
    assert coulomb_energy(whole) < 1.05 * coulomb_energy(thomson(2 * count, seed=1))


def test_cameras_look_at_the_object_the_right_way_up():
    viewpoints = thomson(30, seed=2)
    rotations = view_rotations(viewpoints, np.zeros(1))
    identity = np.broadcast_to(np.eye(3), (30, 3, 3))
    np.testing.assert_allclose(rotations @ rotations.swapaxes(1, 2), identity, atol=1e-12)
    np.testing.assert_allclose(np.linalg.det(rotations), 1.0)
    # The camera stands along its own -z, seen from the object.
    np.testing.assert_allclose(rotations.swapaxes(1, 2) @ [0, 0, -1], viewpoints, atol=1e-12)
    up_in_camera = rotations @ [0, 0, 1]
    assert (up_in_camera[:, 1] < 0).all()  # image y points down
    np.testing.assert_allclose(up_in_camera[:, 0], 0.0, atol=1e-12)


def test_cameras_at_the_poles():
    poles = np.array([[0.0, 0.0, 1.0], [0.0, 0.0, -1.0]])
    rotations = view_rotations(poles, np.zeros(1))
    np.testing.assert_allclose(np.linalg.det(rotations), 1.0)
    np.testing.assert_allclose(rotations.swapaxes(1, 2) @ [0, 0, -1], poles, atol=1e-12)
    np.testing.assert_allclose(rotations @ [0, 1, 0], [[0, -1, 0]] * 2, atol=1e-12)
