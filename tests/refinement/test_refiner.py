"""What holds for every refiner: recovery, order, determinism, bad input."""

from dataclasses import replace

import numpy as np
import pytest

from hlp.geometry import rigid
from hlp.records import Hypotheses
from hlp.refinement.icp import IcpRefiner, IcpSettings
from hlp.refinement.pso import PsoRefiner, PsoSettings
from hlp.refinement.refiner import NoneRefiner
from refinement_scene import SHAPE, colorless, disturbed, error, make_scene, shifted_model


@pytest.fixture
def pso_settings(cost_settings, verification):
    return PsoSettings(cost=cost_settings, verification=verification, second_search=None)


@pytest.fixture
def icp_settings(verification):
    return IcpSettings(verification=verification)


@pytest.fixture(params=["pso", "icp", "none"])
def refiner(request, pso_settings, icp_settings):
    refiners = {
        "pso": PsoRefiner(pso_settings, threads=2),
        "icp": IcpRefiner(icp_settings),
        "none": NoneRefiner(),
    }
    return refiners[request.param]


def hypotheses(*poses):
    return Hypotheses(np.stack(poses), np.ones(len(poses)))


def test_perturbed_poses_are_recovered(pso_settings, icp_settings):
    by_swarm, by_points = PsoRefiner(pso_settings), IcpRefiner(icp_settings)
    for refiner, steps in ((by_swarm, ((20, 15), (30, 20))), (by_points, ((10, 10),))):
        errors = []
        for seed in range(4):
            scene = make_scene(seed)
            coarse = hypotheses(*(disturbed(scene, *step, seed) for step in steps))
            found = refiner.refine(scene.model, scene.seen, coarse, seed=seed)
            errors += [error(scene, each.pose_cam_obj) for each in found]
        assert np.median(errors) < 0.003
        assert sum(each < 0.1 * scene.model.diameter for each in errors) >= len(errors) - 1


def test_the_next_frames_pose_is_followed(pso_settings, icp_settings):
    for refiner in (PsoRefiner(pso_settings), IcpRefiner(icp_settings)):
        errors = []
        for seed in range(4):
            scene = make_scene(seed)
            last = disturbed(scene, 3, 5, seed)
            found = refiner.follow(scene.model, scene.seen, last, seed)
            errors.append(error(scene, found.pose_cam_obj) / error(scene, last))
        assert np.median(errors) < 0.4


def test_results_keep_the_order(scene, refiner):
    far = disturbed(scene, 170, 60, 3)
    coarse = hypotheses(far, disturbed(scene, 3, 3, 1))
    found = refiner.refine(scene.model, scene.seen, coarse, seed=0)
    assert len(found) == 2
    assert error(scene, found[0].pose_cam_obj) > 0.03 > error(scene, found[1].pose_cam_obj)
    for each in found:
        rotation = each.pose_cam_obj[:3, :3]
        np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-9)


def test_same_seed_same_poses(scene, refiner):
    coarse = hypotheses(disturbed(scene, 20, 10, 1), disturbed(scene, 10, 20, 2))
    first, second = (refiner.refine(scene.model, scene.seen, coarse, seed=5) for _ in range(2))
    for a, b in zip(first, second, strict=True):
        np.testing.assert_array_equal(a.pose_cam_obj, b.pose_cam_obj)
        assert a.iterations == b.iterations


def test_no_depth_gives_the_coarse_pose(scene, refiner):
    empty = np.zeros(SHAPE, dtype=np.float32)
    away = scene.pose.copy()
    away[0, 3] = 3.0
    seen = replace(scene, depth=empty).seen
    found = refiner.refine(scene.model, seen, hypotheses(scene.pose, away), seed=0)
    for each, pose in zip(found, (scene.pose, away), strict=True):
        np.testing.assert_allclose(each.pose_cam_obj, pose, atol=1e-15)


def test_no_hypotheses_no_results(scene, refiner):
    none = Hypotheses(np.zeros((0, 4, 4)), np.zeros(0))
    assert refiner.refine(scene.model, scene.seen, none, seed=0) == []


def test_the_meshs_origin_does_not_matter(scene, refiner):
    """Coordinates a metre off their origin, even behind the camera, give the same poses."""
    coarse = np.stack([disturbed(scene, 20, 10, 1), disturbed(scene, 10, 20, 2)])
    expected = refiner.refine(scene.model, scene.seen, hypotheses(*coarse), seed=5)
    along = scene.pose[2, :3]  # the optical axis in object coordinates
    for offset in (along, -along, np.array([0.6, -0.5, 0.7])):
        model, poses = shifted_model(scene.model, offset, coarse)
        found = refiner.refine(model, scene.seen, hypotheses(*poses), seed=5)
        for a, b in zip(found, expected, strict=True):
            pose = a.pose_cam_obj @ rigid(np.eye(3), offset)
            np.testing.assert_allclose(pose, b.pose_cam_obj, atol=1e-9)


def test_threads_do_not_change_the_poses_of_pso(scene, pso_settings):
    coarse = hypotheses(disturbed(scene, 20, 10, 1))
    one, two = (
        PsoRefiner(pso_settings, threads).refine(scene.model, scene.seen, coarse, seed=5)[0]
        for threads in (1, 2)
    )
    np.testing.assert_array_equal(one.pose_cam_obj, two.pose_cam_obj)


def test_the_search_for_objects_without_colours_weighs_colour_edges(scene, pso_settings):
    """Their weight changes where the swarm ends; of coloured objects it changes nothing."""
    coarse = hypotheses(disturbed(scene, 20, 10, 1))
    for model in (scene.model, colorless(scene.model)):
        ends = []
        for weight in (0.0, 0.9):
            cost = replace(pso_settings.cost, weight_image_edge=weight)
            refiner = PsoRefiner(replace(pso_settings, cost=cost))
            ends.append(refiner.refine(model, scene.seen, coarse, seed=5)[0].pose_cam_obj)
        assert np.array_equal(*ends) == model.mesh.colored
