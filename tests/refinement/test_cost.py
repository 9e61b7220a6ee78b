"""The compiled cost against a slow one written here from Eq. 2, and its special cases."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial import cKDTree

from hlp.geometry import project
from hlp.refinement.cost import DepthCost
from hlp.refinement.cost_kernel import WORST, depth_edges
from hlp.rendering.rasterizer import render_depth
from refinement_scene import CAMERA, SHAPE, disturbed


def slow_edges(depth, step):
    """Pixel by pixel: a 4-neighbour is empty or lies farther by more than the step."""
    height, width = depth.shape
    edges = np.zeros(depth.shape, dtype=bool)
    for y, x in np.argwhere(depth > 0):
        for j, i in ((y - 1, x), (y + 1, x), (y, x - 1), (y, x + 1)):
            if 0 <= j < height and 0 <= i < width:
                edges[y, x] |= depth[j, i] == 0 or depth[j, i] > depth[y, x] + step
    return edges


def slow_cost(scene, cost, coarse, pose, s):
    """Eq. 2 on the region's grid, with NumPy and a k-d tree over the observed edgelets."""
    observed, camera = cost.observed, cost.camera_matrix
    first, rendered = render_depth(
        scene.model.proxy, np.stack([coarse, pose]), camera, observed.shape
    ).astype(np.float64)
    drawn, seen = rendered > 0, observed > 0
    tau = s.tau_depth_mm / 1000
    cost_map = np.full(observed.shape, s.missing_cost)
    behind = np.minimum((observed - rendered) / tau, 1.0)
    before = np.minimum((rendered - observed) / tau, s.occluder_cost)
    cost_map[seen] = np.where(observed >= rendered, behind, before)[seen]
    agreed = (first > 0) & seen & (np.abs(first - observed) <= s.reference_mm / 1000)
    uncovered = np.count_nonzero(agreed & ~drawn)
    total = cost_map[drawn].sum() + s.uncovered_cost * uncovered
    depth_cost = total / (np.count_nonzero(drawn) + uncovered * (s.uncovered_cost > 0))

    step = s.edge_step_mm / 1000
    own = np.argwhere(slow_edges(rendered, step))
    theirs = np.argwhere(slow_edges(observed, step))
    centre = coarse[:3, :3] @ scene.model.proxy.vertices.T + coarse[:3, 3:]
    tau_edge = s.tau_edge_mm / 1000 * camera[0, 0] / centre[2].mean()
    distance = np.minimum(cKDTree(theirs).query(own)[0] / tau_edge, 1.0)
    at = tuple(own.T)
    hidden = seen[at] & (rendered[at] - observed[at] > tau)
    edge_cost = np.where(hidden, s.occluder_cost, distance).mean()
    return float(s.weight_depth * depth_cost + s.weight_edge * edge_cost)


@pytest.mark.parametrize("changes", [{}, {"uncovered_cost": 0.0, "roi_size": 50}])
def test_cost_equals_the_slow_reference(scene, cost_settings, changes):
    settings = replace(cost_settings, **changes)
    coarse = disturbed(scene, 12, 12, seed=1)
    cost = DepthCost(scene.model.proxy, scene.depth, CAMERA, coarse, settings)
    poses = np.stack([coarse] + [disturbed(scene, 9 * k, 8 * k, seed=k) for k in range(5)])
    expected = [slow_cost(scene, cost, coarse, pose, settings) for pose in poses]
    assert np.ptp(expected) > 0.1
    np.testing.assert_allclose(cost.evaluate(poses), expected, atol=1e-6)


def test_edges_are_compared_with_those_of_their_own_direction(scene, cost_settings):
    """With distances given by direction, against loops written here; the rest stays as it is."""
    pose = disturbed(scene, 6, 6, seed=2)
    given = np.random.default_rng(1).uniform(0, 30, (4, *scene.depth.shape)).astype(np.float32)
    full_size = replace(cost_settings, roi_size=2048)
    blind = DepthCost(scene.model.proxy, scene.depth, CAMERA, pose, full_size)
    cost = DepthCost(scene.model.proxy, scene.depth, CAMERA, pose, full_size, given)
    found, others = cost.terms(pose[None])[0], blind.terms(pose[None])[0]

    observed, camera = cost.observed, cost.camera_matrix
    assert camera[0, 0] == CAMERA[0, 0]  # cut out, not made smaller
    left, top = np.rint(CAMERA[:2, 2] - camera[:2, 2]).astype(int)
    rendered = cost.render(pose)
    at = slice(top, top + observed.shape[0]), slice(left, left + observed.shape[1])
    inverse = np.pad(np.divide(1, rendered, out=np.zeros_like(rendered), where=rendered > 0), 1)
    centre = pose[:3, :3] @ scene.model.proxy.vertices.T + pose[:3, 3:]
    tau_pixels = cost_settings.tau_edge_mm / 1000 * CAMERA[0, 0] / centre[2].mean()
    total, used = 0.0, set()
    for y, x in np.argwhere(slow_edges(rendered, cost_settings.edge_step_mm / 1000)):
        if 0 < observed[y, x] < rendered[y, x] - cost_settings.tau_depth_mm / 1e3:
            total += cost_settings.occluder_cost
            continue
        around = inverse[y : y + 3, x : x + 3]
        sobel = np.array([[-1, 0, 1], [-2, 0, 2], [-1, 0, 1]])
        angle = np.arctan2((around * sobel.T).sum(), (around * sobel).sum())
        direction = round(angle / (np.pi / 4)) % 4
        used.add(direction)
        total += min(given[direction][at][y, x] / tau_pixels, 1.0)
    assert used == {0, 1, 2, 3}
    np.testing.assert_allclose(found[3], total, rtol=1e-4)
    np.testing.assert_array_equal(np.delete(found, 3), np.delete(others, 3))


@pytest.mark.parametrize("pixel", [(0, 120), (319, 120), (160, 0), (160, 239)])
def test_at_the_images_borders_one_image_for_all_directions_changes_nothing(
    scene, cost_settings, pixel
):
    pose = scene.pose.copy()
    pose[:2, 3] = pose[2, 3] * (pixel - CAMERA[:2, 2]) / np.diag(CAMERA)[:2]
    pose[:3, 3] += scene.pose[:3, :3] @ -scene.model.centroid
    distance = np.random.default_rng(1).uniform(0, 9, (1, *scene.depth.shape)).astype(np.float32)
    arguments = scene.model.proxy, scene.depth, CAMERA, pose, replace(cost_settings, roi_size=2048)
    one, four = (DepthCost(*arguments, np.repeat(distance, n, axis=0)) for n in (1, 4))
    assert (drawn := one.render(pose))[[0, -1]].any() or drawn[:, [0, -1]].any()
    np.testing.assert_allclose(four.terms(pose[None]), one.terms(pose[None]), rtol=1e-5)


def test_an_open_mesh_costs_the_same_from_its_inside(scene, cost_settings):
    """Without its culled triangles a mesh is open: nothing may be culled then."""
    model = scene.model
    half = replace(model.proxy, faces=model.proxy.faces[::2, ::-1])
    opened = replace(scene, model=replace(model, proxy=half))
    cost = DepthCost(half, scene.depth, CAMERA, scene.pose, cost_settings)
    expected = slow_cost(opened, cost, scene.pose, scene.pose, cost_settings)
    np.testing.assert_allclose(cost.evaluate(scene.pose[None])[0], expected, atol=1e-6)


def test_region_samples_pixels_of_the_image_under_its_own_camera(scene, cost_settings):
    """A ramp as depth says where each sample comes from: at most half a pixel from its ray."""
    y, x = np.mgrid[: SHAPE[0], : SHAPE[1]]
    for size in (1000, 96, 41):
        settings = replace(cost_settings, roi_size=size, uncovered_cost=0.0)
        samples = []
        for ramp in (1.0 + x, 1.0 + y):
            cost = DepthCost(scene.model.proxy, ramp, CAMERA, scene.pose, settings)
            samples.append(cost.observed - 1.0)
        height, width = cost.observed.shape
        assert max(height, width) <= size
        rows, columns = np.mgrid[:height, :width]
        rays = np.linalg.inv(cost.camera_matrix) @ np.stack(
            [columns.ravel(), rows.ravel(), np.ones(columns.size)]
        )
        there = project(rays.T, CAMERA).reshape(height, width, 2)
        assert np.abs(there - np.stack(samples, axis=-1)).max() <= 0.5 + 1e-9
    cost = DepthCost(scene.model.proxy, ramp, CAMERA, scene.pose, cost_settings)
    assert max(cost.observed.shape) > 80


def test_edges_are_on_the_near_side():
    depth = np.full((6, 8), 1.0)
    depth[:, 4:] = 0.9
    expected = np.zeros((6, 8), dtype=bool)
    expected[:, 4] = True
    for y, x in ((1, 1), (3, 1), (2, 0), (2, 2)):
        expected[y, x] = True
    for missing in (0.0, np.nan, np.inf, -1.0):
        depth[2, 1] = missing
        np.testing.assert_array_equal(depth_edges(depth, 0.05), expected)
    assert not depth_edges(depth[3:], 0.2).any()


@pytest.mark.parametrize("fill", [0.0, np.nan])
def test_without_depth_or_out_of_the_image_the_cost_is_the_worst(scene, cost_settings, fill):
    empty = np.full(SHAPE, fill, dtype=np.float32)
    away, behind = scene.pose.copy(), scene.pose.copy()
    away[0, 3], behind[2, 3] = 5.0, -1.0
    for depth, pose in ((empty, scene.pose), (scene.depth, away), (scene.depth, behind)):
        cost = DepthCost(scene.model.proxy, depth, CAMERA, pose, cost_settings)
        assert cost.evaluate(pose[None])[0] == WORST
