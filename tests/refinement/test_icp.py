"""Alignment of coarse poses: one step against plain NumPy, and where it ends."""

import numpy as np
import pytest

from hlp.geometry import back_project, project, rotation_distance, transform
from hlp.refinement.icp import align_to_depth
from hlp.rendering.surface import sample_surface
from refinement_scene import disturbed, error, make_scene


def aligned_once(pose, scene, limit):
    """One step of least squares: its turn about the centroid (rad) and its shift (m)."""
    model, camera = scene.model, scene.camera_matrix
    surface = sample_surface(model.proxy, 150)
    centre = transform(pose, model.centroid[None])[0]
    points, normals = transform(pose, surface.points), surface.normals @ pose[:3, :3].T
    pixels = np.floor(project(points, camera) + 0.5).astype(int)
    height, width = scene.depth.shape
    inside = ((pixels >= 0) & (pixels < [width, height])).all(axis=1)
    depth = np.where(inside, scene.depth[tuple(np.where(inside[:, None], pixels, 0).T[::-1])], 0.0)
    rays = points / np.linalg.norm(points, axis=1, keepdims=True)
    used = (np.abs(depth - points[:, 2]) <= limit) & ((rays * normals).sum(axis=1) <= -0.2)
    seen = back_project(pixels.astype(float), depth, camera)
    distances = ((seen - points) * normals).sum(axis=1)
    effects = np.concatenate([np.cross(points - centre, normals), normals], axis=1)
    weights = used / (1.0 + (distances / (0.3 * limit)) ** 2)
    damping = weights.sum() * np.repeat([1e-3 * model.diameter**2, 1e-2], 3)
    products = effects.T @ (weights[:, None] * effects) + np.diag(damping)
    return np.linalg.solve(products, effects.T @ (weights * distances))


@pytest.mark.parametrize("seed", range(3))
def test_a_step_is_the_least_squares_one(seed):
    scene = make_scene(seed)
    pose, limit = disturbed(scene, 4, 4, seed), 0.02
    (found,) = align_to_depth(pose[None], scene.model, scene.seen, np.array([limit]))
    step = aligned_once(pose, scene, limit)
    centres = transform(np.stack([pose, found]), scene.model.centroid[None])[:, 0]
    np.testing.assert_allclose(centres[1] - centres[0], step[3:], atol=1e-9)
    angle = 2.0 * np.arctan(np.linalg.norm(step[:3]) / 2.0)
    assert rotation_distance(found[:3, :3], pose[:3, :3]) == pytest.approx(angle, abs=1e-9)


def test_coarse_poses_end_near_the_true_one():
    for seed in range(4):
        scene = make_scene(seed)
        coarse = np.stack([disturbed(scene, 14, 8, k) for k in range(6)])
        found = align_to_depth(coarse, scene.model, scene.seen)
        before, after = (np.median([error(scene, p) for p in poses]) for poses in (coarse, found))
        assert after < 0.4 * before
        (alone,) = align_to_depth(coarse[3:4], scene.model, scene.seen)
        np.testing.assert_allclose(alone, found[3], atol=1e-12)
