"""The verification cost against plain NumPy, and what it must tell apart."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.ndimage import distance_transform_edt, sobel

from hlp.image_edges import NO_EDGE, color_edges
from hlp.refinement import verification
from hlp.refinement.cost_kernel import WORST, depth_edges
from hlp.refinement.verification import Evidence, Verifier, observe
from hlp.rendering.rasterizer import render_depth, render_rgbd
from hlp.rendering.shading import Light
from packed_boxes import POSES, WHITE, box, frame
from refinement_scene import CAMERA, SHAPE, colorless, disturbed, error, make_scene

AMBIENT = Light((0.0, 0.0, -1.0), 1.0, 0.0, 0.0, 1.0)


def reference(scene, pose, settings):
    """Evidence over the whole image, spelled out."""
    rendered = render_depth(scene.model.proxy, pose[None], CAMERA, SHAPE)[0].astype(float)
    albedo, _ = render_rgbd(scene.model.proxy, pose, CAMERA, SHAPE, AMBIENT)
    observed, on = scene.depth.astype(float), rendered > 0
    apart, seen = observed - rendered, on & (observed > 0)
    tau = settings.tau_depth_mm / 1000
    agree, occluded = seen & (np.abs(apart) <= tau), seen & (apart < -tau)
    colors = [image[agree] + 4.0 for image in (scene.rgb.astype(float), albedo.astype(float))]
    shares = [color / color.sum(axis=1, keepdims=True) for color in colors]
    color = np.minimum(np.abs(shares[0] - shares[1]).sum(axis=1) / settings.tau_color, 1.0)
    step = settings.edge_step_mm / 1000
    edges = depth_edges(rendered, step) & on
    points = scene.model.proxy.vertices @ pose[2, :3] + pose[2, 3]
    reach = settings.tau_edge_mm / 1000 * CAMERA[0, 0] * np.mean(1 / points)
    of_depth = distance_transform_edt(~depth_edges(observed, step)) / reach
    distance = of_depth
    if not scene.model.mesh.colored:
        distance = np.minimum(of_depth, image_distance(scene, rendered, settings, reach))
    pixels = on.sum()
    return Evidence(
        float(agree.sum()),
        np.abs(apart[agree]).sum() / tau / pixels,
        (seen & (apart > tau)).sum() / pixels,
        occluded.sum() / pixels,
        (on & ~seen).sum() / pixels,
        color.mean(),
        np.minimum(distance[edges & ~occluded], 1.0).mean(),
        (edges & occluded).sum() / edges.sum(),
    )


def image_distance(scene, rendered, settings, reach):
    """Distance to the next colour edge whose gradient is at most 34° off that of the rendering."""
    inverse = np.where(rendered > 0, 1.0 / np.where(rendered > 0, rendered, 1.0), 0.0)
    turn = np.arctan2(sobel(inverse, axis=0), sobel(inverse, axis=1))
    nearest = np.rint(turn / (np.pi / 4)).astype(int) % 4
    edges = color_edges(scene.rgb)
    maps = []
    for k in range(4):
        away = np.abs(edges - 4 * k)
        near = (edges != NO_EDGE) & (np.minimum(away, 16 - away) <= 3)
        maps.append(distance_transform_edt(~near))
    chosen = np.take_along_axis(np.stack(maps), nearest[None], axis=0)[0]
    return chosen / reach * settings.tau_edge_mm / settings.tau_image_edge_mm


def evidence(scene, pose, settings):
    found = Verifier(scene.model, settings).evidence(seen(scene, settings), pose[None])
    return Evidence(*(values[0] for values in found))


def seen(scene, settings):
    return observe(scene.rgb, scene.depth, CAMERA, settings)


def cost(scene, pose, settings):
    return float(Verifier(scene.model, settings).costs(seen(scene, settings), pose[None])[0])


@pytest.mark.parametrize("colored", [True, False])
@pytest.mark.parametrize("step", [(0, 0), (15, 10), (60, 30)])
def test_evidence_is_what_plain_numpy_finds(scene, verification, step, colored):
    scene = scene if colored else replace(scene, model=colorless(scene.model))
    pose = disturbed(scene, *step, seed=2)
    fine = replace(verification, roi_size=1000)
    found, expected = evidence(scene, pose, fine), reference(scene, pose, fine)
    for name in ("residual", "behind", "occluded", "missing", "color", "edges_occluded"):
        assert getattr(found, name) == pytest.approx(getattr(expected, name), abs=0.01), name
    assert found.area == pytest.approx(expected.area, rel=0.01)
    # Distances to observed edges are approximate.
    assert found.edge == pytest.approx(expected.edge, abs=0.02)


def test_a_coarser_grid_sees_much_the_same(scene, verification):
    fine = evidence(scene, scene.pose, replace(verification, roi_size=1000))
    coarse = evidence(scene, scene.pose, replace(verification, roi_size=40))
    assert coarse.area == pytest.approx(fine.area, rel=0.1)
    for name in ("residual", "behind", "occluded", "missing", "color"):
        assert getattr(coarse, name) == pytest.approx(getattr(fine, name), abs=0.05), name


def test_the_cost_weighs_the_evidence(verification):
    shares = (0.1, 0.2, 0.4, 0.3, 0.5, 0.6, 0.25)
    seen = Evidence(np.zeros(1), *(np.array([share]) for share in shares))
    depth = 0.1 + 0.2 + (0.1 + 0.2 * 0.4) * 0.4 + 0.3 * 0.3
    edge = 0.75 * 0.6 + 0.5 * 0.25
    expected = (0.8 * depth + 0.3 * edge + 0.2 * 0.5) / 1.3
    verifier = Verifier(make_scene(0).model, verification)
    assert verifier.weigh(seen) == pytest.approx([expected])


def test_the_true_pose_costs_least(verification):
    for seed in range(3):
        scene = make_scene(seed)
        true = cost(scene, scene.pose, verification)
        for k in range(8):
            pose = disturbed(scene, 10 + 8 * k, 5 + 2 * k, seed=k)
            assert error(scene, pose) > 0.005
            assert true < cost(scene, pose, verification) - 0.03


def test_occlusion_costs_less_than_free_space_but_not_nothing(verification):
    scene = make_scene(0, hidden=False)
    wall = replace(scene, depth=np.full(SHAPE, 0.3, dtype=np.float32))
    behind = replace(scene, depth=np.full(SHAPE, 2.0, dtype=np.float32))
    true = cost(scene, scene.pose, verification)
    assert true < cost(wall, scene.pose, verification) < cost(behind, scene.pose, verification)


def test_colour_takes_no_part_for_a_mesh_without_colours(scene, verification):
    grey = colorless(scene.model)
    verification = replace(verification, tau_image_edge_mm=None)
    observation, poses = seen(scene, verification), scene.pose[None]
    blind = replace(verification, weight_color=0.0)
    expected = Verifier(scene.model, blind).costs(observation, poses)
    assert Verifier(grey, verification).costs(observation, poses) == expected


def test_competing_poses_pay_for_a_smaller_agreeing_area(scene, verification):
    away = scene.pose.copy()
    away[:3, 3] += [0.12, 0.05, 0.04]  # elsewhere, on the table: no competitor
    poses = np.stack([scene.pose, disturbed(scene, 25, 5, seed=4), away])
    verifier = Verifier(scene.model, verification)
    observation = seen(scene, verification)
    areas = [evidence(scene, pose, verification).area for pose in poses]
    expected = verifier.costs(observation, poses)
    expected[1] += verification.unexplained_cost * (1 - areas[1] / areas[0])
    assert areas[1] < 0.9 * areas[0] and 0 < areas[2] < 0.9 * areas[0]
    found = verifier.evidence(observation, poses)
    costs = verifier.competing_costs(found, poses, np.full(3, 7.0))
    np.testing.assert_allclose(costs, np.minimum(expected, 1.0))
    alone = verifier.evidence(observation, poses[:1])
    np.testing.assert_allclose(verifier.competing_costs(alone, poses[:1], np.ones(1)), expected[:1])


def test_poses_with_few_votes_pay_for_it(scene, verification):
    poses = np.repeat(scene.pose[None], 3, axis=0)
    verifier = Verifier(scene.model, verification)
    evidence = verifier.evidence(seen(scene, verification), poses)
    found = verifier.competing_costs(evidence, poses, np.array([5.0, 50.0, 0.0]))
    weight = verification.support_cost
    np.testing.assert_allclose(found - found[1], [weight * np.log(10), 0.0, weight * np.log(100)])


@pytest.mark.parametrize("fill", [0.0, np.nan])
def test_without_depth_or_out_of_the_image_the_cost_is_the_worst(scene, verification, fill):
    empty = replace(scene, depth=np.full(SHAPE, fill, dtype=np.float32))
    away, behind = scene.pose.copy(), scene.pose.copy()
    away[0, 3], behind[2, 3] = 5.0, -1.0
    assert cost(empty, scene.pose, verification) == WORST
    assert cost(scene, away, verification) == WORST
    assert cost(scene, behind, verification) == WORST


def test_poses_are_judged_alone(scene, verification):
    """What was drawn or summed of one pose is gone before the next."""
    poses = np.stack([disturbed(scene, 10, 10, seed=k) for k in range(5)])
    verifier, observation = Verifier(scene.model, verification), seen(scene, verification)
    alone = [verifier.costs(observation, pose[None])[0] for pose in poses]
    np.testing.assert_array_equal(verifier.costs(observation, poses), alone)


def test_an_objects_depth_is_drawn_once_in_an_image_and_its_copies(monkeypatch):
    """By each verifier for itself; what was drawn does not grow without end."""
    verifier, other, seen = box(), box((0.04, 0.1, 0.08)), frame(box(), WHITE).observation
    drawn = verifier.depth_of(seen, POSES[1])
    rest = verifier.without_explained(seen, POSES[1])
    assert verifier.depth_of(rest, POSES[1].copy()) is drawn is not other.depth_of(seen, POSES[1])
    monkeypatch.setattr(verification, "_DRAWN", 2)  # which are there already
    again = verifier.depth_of(seen, POSES[0])
    np.testing.assert_array_equal(verifier.depth_of(seen, POSES[1]).depth, drawn.depth)
    assert len(seen.drawn) == 2 and verifier.depth_of(seen, POSES[0]) is again
