"""Templates of gradient directions: a flat part of one colour on a plane of another."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
import trimesh

from hlp.geometry import inverse, rigid, transform
from hlp.image_edges import NO_EDGE, color_edges, edges
from hlp.rendering.rasterizer import render_scene
from hlp.rendering.shading import FRONTAL_LIGHT
from hlp.rendering.views import thomson
from hlp.templates import matching
from hlp.templates.building import DIRECTIONS, Templates, TemplateSettings, build_templates
from hlp.templates.matching import at_different_places, match_templates, spread_edges
from hlp.templates.scanning import Places
from hlp.threads import ThreadTeam
from refinement_scene import as_mesh, model_of, posed

CAMERA = np.array([[600.0, 0.0, 320.0], [0.0, 600.0, 240.0], [0.0, 0.0, 1.0]])
SHAPE = (480, 640)
SETTINGS, ALONE = TemplateSettings(), ThreadTeam(1)
HALF_TURNS = [(1.0, 1.0, 1.0), (1.0, -1.0, -1.0), (-1.0, 1.0, -1.0), (-1.0, -1.0, 1.0)]


@pytest.fixture(scope="module")
def plate():
    """A letter F, 10 cm long and 12 mm thick: no symmetry, no colour."""
    sizes, places = [(0.1, 0.02), (0.02, 0.06), (0.02, 0.04)], [(0, 0), (0.04, 0.03), (0, 0.02)]
    boxes = []
    for size, at in zip(sizes, places, strict=True):
        box = trimesh.creation.box((*size, 0.012))
        box.apply_translation((*at, 0.0))
        boxes.append(box)
    return model_of(trimesh.util.concatenate(boxes))


@pytest.fixture(scope="module")
def templates(plate):
    return build_templates(plate, SETTINGS)


def scene(plate, turn, at=(0.05, -0.03, 0.6)):
    """RGB, depth and true pose of the plate on a table that is tilted towards the camera."""
    flat = trimesh.transformations.rotation_matrix(np.pi - 0.25, [1, 0, 0])[:3, :3]
    rotation = flat @ trimesh.transformations.rotation_matrix(turn, [0, 0, 1])[:3, :3]
    pose = posed(plate, rotation, np.array(at))
    table = as_mesh(trimesh.creation.box((0.7, 0.7, 0.01)), (70, 100, 150))
    under = rigid(flat, np.array(at) - flat @ [0.0, 0.0, 0.011])
    painted = replace(plate.mesh, colors=np.full_like(plate.mesh.colors, 200))
    rgb, depth, _ = render_scene([(painted, pose), (table, under)], CAMERA, SHAPE, FRONTAL_LIGHT)
    return rgb, depth, pose


def look(plate, templates, rgb, depth, mask=None, team=ALONE):
    """The matches in an image, and the places without any."""
    near = spread_edges(color_edges(rgb), SETTINGS.reach)
    return match_templates(templates, near, depth, CAMERA, plate, SETTINGS, mask, team)


def least_error(poses, pose, plate):
    """Mean distance of the vertices at the nearest of the found poses, in diameters."""
    at, true = (transform(each, plate.mesh.vertices) for each in (poses, pose))
    return np.linalg.norm(at - true, axis=2).mean(axis=1).min() / plate.diameter


def test_a_flat_part_without_colour_is_found(plate, templates):
    rgb, depth, pose = scene(plate, 2.0)
    found, (x, y) = look(plate, templates, rgb, depth, team=ThreadTeam(2))
    assert least_error(found.poses_cam_obj[:10], pose, plate) < 0.15
    assert (np.diff(found.support) <= 0).all() and found.support[0] > 0.7
    barren = np.zeros(SHAPE, dtype=bool)
    barren[y, x] = True
    assert 0.8 < 64 * barren.sum() / barren.size < 1.0
    for mask in (None, ~barren):
        same, _ = look(plate, templates, rgb, depth, mask)
        np.testing.assert_array_equal(same.poses_cam_obj, found.poses_cam_obj)
    assert len(look(plate, templates, rgb, depth, barren)[0].support) == 0


@pytest.mark.parametrize("at", [(-0.31, 0, 0.6), (0.305, 0, 0.6), (0, -0.22, 0.6), (0, 0.235, 0.6)])
def test_a_part_that_the_image_cuts_off_is_found(plate, templates, at):
    """At each border: what lies beyond it has no edges, and its surface is not seen."""
    rgb, depth, pose = scene(plate, 2.0, at)
    points = plate.mesh.vertices
    x, y = (transform(pose, points) @ CAMERA.T).T[:2] / transform(pose, points)[:, 2]
    beyond = (x < 0) | (x > SHAPE[1] - 1) | (y < 0) | (y > SHAPE[0] - 1)
    assert beyond.any() and not beyond.all()
    assert least_error(look(plate, templates, rgb, depth)[0].poses_cam_obj, pose, plate) < 0.15


def test_a_part_is_found_behind_what_hides_its_middle(plate, templates):
    """Another anchor of its templates is seen, and enough of the surface and the edges."""
    rgb, depth, pose = scene(plate, 2.0)
    middle = transform(pose, plate.centroid[None])[0]
    u, v = (CAMERA @ middle)[:2] / middle[2]
    x, y = np.meshgrid(np.arange(SHAPE[1]), np.arange(SHAPE[0]))
    along = pose[:2, 0] / np.linalg.norm(pose[:2, 0])
    hides = np.abs(along[0] * (x - u) + along[1] * (y - v)) < 14.0
    depth[hides], rgb[hides] = 0.5, (120, 40, 40)
    assert least_error(look(plate, templates, rgb, depth)[0].poses_cam_obj, pose, plate) < 0.15


def test_a_template_lies_only_where_the_surface_is_turned_as_its_own(plate, templates):
    """Laid on a tilted plane with edges everywhere, a face within 46° of the plane is seen."""
    x, y = np.meshgrid(np.arange(SHAPE[1]), np.arange(SHAPE[0]))
    right, down = np.abs(x - CAMERA[0, 2]), np.abs(y - CAMERA[1, 2])
    tilt = np.deg2rad(50.0)
    depth = 0.6 / (1.0 - np.tan(tilt) * (x - CAMERA[0, 2]) / CAMERA[0, 0])
    depth = np.where((depth > 0.2) & (depth < 1.5), depth, 0.0).astype(np.float32)
    near = np.full(SHAPE, 255, dtype=np.uint8)
    seen = near, depth, CAMERA, plate, SETTINGS, (right < 60) & (down < 60), ALONE
    found = match_templates(templates, *seen)[0].poses_cam_obj
    towards = -np.array([-np.sin(tilt), 0.0, np.cos(tilt)])
    normals = plate.mesh.normals @ np.swapaxes(found[:, :3, :3], 1, 2)
    assert len(found) > 20 and (normals @ towards).max(axis=1).min() > np.cos(np.deg2rad(46.0))


def test_a_template_is_what_its_view_shows(plate, templates):
    """Laid on a picture of its own view, all its features are found, with all depths."""
    for row in range(5, len(templates.offsets), 531):
        rotation, center = templates.rotations_cam_obj[row], np.array([0.0, 0.0, 0.5])
        pose = posed(plate, rotation, center)
        _, depth, _ = render_scene([(plate.mesh, pose)], CAMERA, SHAPE, FRONTAL_LIGHT)
        directions = edges((depth > 0.0)[..., None].astype(np.float32), 0.05)
        anchor = center + templates.anchors_cam[row]
        pixel = anchor[:2] / anchor[2] * 600.0 + CAMERA[:2, 2]
        places = pixel + templates.offsets[row] * 600.0 / 0.5
        y, x = np.nonzero(directions != NO_EDGE)
        apart = np.hypot(x[:, None] - places[:, 0], y[:, None] - places[:, 1])
        on_outline = apart.min(axis=0) < 2.5
        assert on_outline.mean() > 0.5
        nearest = apart.argmin(axis=0)[on_outline]
        eighths = directions[y[nearest], x[nearest]] / 2.0
        away = np.abs(templates.directions[row][on_outline] - eighths)
        assert np.median(np.minimum(away, DIRECTIONS - away)) <= 0.5
        shown = np.rint(pixel + templates.surface[row][:2].T * 600.0 / 0.5).astype(int)
        deep = depth[shown[:, 1], shown[:, 0]] - anchor[2]
        assert np.median(np.abs(deep - templates.surface[row][2])) < 0.002


def test_places_looked_at_together_have_what_each_has_alone(plate, templates, monkeypatch):
    """On a steep plane nearly full of edges: no share is wrong, and few are passed over."""
    noise = cv2.GaussianBlur(np.random.default_rng(0).random((*SHAPE, 3)), (0, 0), 6.0)
    rgb = np.uint8(255.0 * (noise - noise.min()) / np.ptp(noise))
    rgb[:60] = 128
    depth = np.tile(1.0 / np.linspace(2.5, 1.2, SHAPE[1], dtype=np.float32), (SHAPE[0], 1))
    given, best = [], matching.best_templates
    monkeypatch.setattr(matching, "best_templates", lambda *of: given.append(of) or best(*of))
    look(plate, templates, rgb, depth)
    (places, *of), (shares, rows) = given[0], best(*given[0])
    some = np.flatnonzero(shares[:, 0] >= SETTINGS.least_match)[::20]
    alone = [best(Places(*(part[[n]] for part in places)), *of) for n in some]
    once, at = (np.concatenate(parts) for parts in zip(*alone, strict=True))
    assert len(some) > 100 and (shares[some] <= once).all()
    assert (shares[some, 0] == once[:, 0]).mean() > 0.95 and (rows[some] == at).mean() > 0.8


def test_edges_are_spread_as_by_plain_numpy():
    rng = np.random.default_rng(0)
    directions = np.where(rng.random((30, 40)) < 0.02, rng.integers(16, size=(30, 40)), NO_EDGE)
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (5, 5))
    expected = np.zeros((30, 40), dtype=np.uint8)
    for y, x in np.argwhere(directions != NO_EDGE):
        for v in range(max(y - 2, 0), min(y + 3, 30)):
            for u in range(max(x - 2, 0), min(x + 3, 40)):
                if disc[v - y + 2, u - x + 2]:
                    expected[v, u] |= 1 << (directions[y, x] + 1) // 2 % DIRECTIONS
    np.testing.assert_array_equal(spread_edges(directions.astype(np.int8), 2), expected)


def test_the_share_of_features_is_that_of_plain_numpy(plate, templates):
    """One template at one place, where some of its surface is hidden, missing, or not seen."""
    rng, settings = np.random.default_rng(0), replace(SETTINGS, least_match=0.49)
    near = np.packbits(rng.random((*SHAPE, 8)) < 0.32, axis=-1)[..., 0]
    x, y, shares, expected = 316, 236, [], []
    for row in range(0, len(templates.offsets), 17):
        one = Templates(*(part[[row]] for part in templates))
        one = one._replace(normals_cam=np.zeros_like(one.normals_cam))  # fits any surface
        blocks = rng.choice([0.6, 0.5, 0.75, 0.0], (60, 80), p=[0.82, 0.1, 0.05, 0.03])
        blocks[28:31, 38:41] = 0.6
        depth = np.kron(blocks, np.ones((8, 8))).astype(np.float32)
        place = np.zeros(SHAPE, dtype=bool)
        place[y, x] = True
        seen = near, depth, CAMERA, plate, settings, place, ALONE
        shares.append(match_templates(one, *seen)[0].support.tolist())

        smooth, scale = cv2.medianBlur(depth, 5), 600.0 / (0.6 - one.anchors_cam[0, 2])
        u, v = np.floor(scale * one.surface[0, :2] + [[x + 0.5], [y + 0.5]]).astype(int)
        behind = smooth[v, u] - 0.6 - one.surface[0, 2]
        limit = 0.12 * plate.diameter
        there = (behind > limit).sum() <= 4 and (np.abs(behind) > limit).sum() <= 9
        u, v = np.floor(scale * one.offsets[0].T + [[x + 0.5], [y + 0.5]]).astype(int)
        same, after, before = (near[v, u] >> (one.directions[0] + by) % 8 & 1 for by in (0, 1, 7))
        found = np.where(same, 1.0, np.where(after | before, 0.5, 0.0))
        enough = there and min(found[:16].mean(), found.mean()) >= 0.49
        expected.append([found.mean()] if enough else [])
    assert 20 < sum(map(len, expected)) < 0.8 * len(expected)
    assert [len(share) for share in shares] == [len(share) for share in expected]
    np.testing.assert_allclose(np.concatenate(shares), np.concatenate(expected), rtol=1e-6)


def test_an_object_without_enough_edges_has_no_templates(plate):
    small = replace(plate, mesh=plate.mesh, diameter=20.0)  # a speck in views of 20 m
    none = build_templates(small, SETTINGS)
    assert len(none.offsets) == 0
    assert look(plate, none, *scene(plate, 0.0)[:2])[0].poses_cam_obj.shape == (0, 4, 4)


def test_few_poses_of_one_place_are_kept(plate):
    """The first ones, wherever the mesh's origin and however the object is turned."""
    middles = np.array([[0.0, 0.0, 0.6]] * 3 + [[0.2, 0.0, 0.6]] + [[0.0, 0.001, 0.6]])
    turns = [trimesh.transformations.rotation_matrix(t, [0, 0, 1])[:3, :3] for t in range(5)]
    poses = np.stack([posed(plate, *each) for each in zip(turns, middles, strict=True)])
    assert at_different_places(poses, plate, 2).tolist() == [0, 1, 3]
    assert at_different_places(poses, plate, 4).tolist() == [0, 1, 2, 3, 4]
    assert at_different_places(poses[:0], plate, 2).tolist() == []
    back, about = rigid(np.swapaxes(turns, 1, 2), np.zeros(3)), rigid(np.eye(3), plate.centroid)
    round_plate = replace(plate, symmetries=about @ back @ inverse(about))
    assert at_different_places(poses, round_plate, 4).tolist() == [0, 3]


def test_symmetries_leave_out_views_and_hardly_a_gap(plate):
    """Every direction has a view near it or near an equivalent one: 23° (all views: 20°)."""
    half_turns = np.stack([rigid(np.diag(d), np.zeros(3)) for d in HALF_TURNS])
    carton = replace(plate, symmetries=half_turns)
    views = build_templates(carton, SETTINGS).rotations_cam_obj
    assert len(views) < 0.5 * len(build_templates(plate, SETTINGS).rotations_cam_obj)
    towards = -views[:, 2]
    for direction in thomson(200, 1):
        nearest = (towards @ (half_turns[:, :3, :3] @ direction).T).max()
        assert np.degrees(np.arccos(nearest)) < 23.5
