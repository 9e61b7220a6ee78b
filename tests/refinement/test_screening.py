from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from hlp.records import Hypotheses
from hlp.refinement.screening import screen


def hypotheses_around(pose, count, rng):
    """The pose itself at a random place among others, turned by 60–180° about the centroid."""
    poses = np.repeat(pose[None], count, axis=0)
    own = int(rng.integers(count))
    for i in range(count):
        if i != own:
            axis = rng.normal(size=3)
            angle = rng.uniform(np.pi / 3, np.pi)
            turn = Rotation.from_rotvec(axis / np.linalg.norm(axis) * angle).as_matrix()
            poses[i, :3, :3] = pose[:3, :3] @ turn
    return own, Hypotheses(poses, np.arange(count, 0, -1.0))


@pytest.mark.parametrize("seed", range(4))
def test_the_pose_that_fits_is_kept_and_the_order_of_the_votes_stays(scene, cost_settings, seed):
    own, found = hypotheses_around(scene.pose, 8, np.random.default_rng(seed))
    few = replace(cost_settings, candidates=3)
    kept = screen(scene.model, scene.depth, scene.camera_matrix, found, few)
    assert len(kept) == 3
    assert own in kept
    assert (np.diff(kept) > 0).all()


def test_no_more_than_asked_for_is_left_alone(scene, cost_settings):
    _, found = hypotheses_around(scene.pose, 5, np.random.default_rng(0))
    kept = screen(scene.model, scene.depth, scene.camera_matrix, found, cost_settings)
    assert kept.tolist() == [0, 1, 2, 3, 4]


def test_a_pose_that_is_no_pose_is_named(scene, cost_settings):
    _, found = hypotheses_around(scene.pose, 6, np.random.default_rng(0))
    found.poses_cam_obj[4, 0, 3] = np.nan
    with pytest.raises(ValueError, match="hypothesis 4"):
        screen(scene.model, scene.depth, scene.camera_matrix, found, cost_settings)
