"""Choosing among near symmetries: the answer is one of them, whichever the search began at."""

import numpy as np
import trimesh
from hypothesis import given
from hypothesis import strategies as st

from generated_values import SEEDS, numbers, rotations, share_of_examples
from hlp.geometry import rigid, rotation_distance
from hlp.records import Mesh, ObjectModel
from hlp.refinement.texture import choose_by_texture, choose_nearby_by_texture
from hlp.refinement.verification import VerificationSettings, observe
from hlp.rendering.light import FRONTAL_LIGHT
from hlp.rendering.rasterizer import render_scene

CAMERA = np.array([[260.0, 0.0, 79.5], [0.0, 260.0, 59.5], [0.0, 0.0, 1.0]])
SHAPE = (120, 160)
HALF_TURNS = np.stack([np.diag([*signs, 1.0]) for signs in ([-1, -1, 1], [1, -1, -1], [-1, 1, -1])])
ALL = np.concatenate([np.eye(4)[None], HALF_TURNS])


def painted_box(seed: int) -> ObjectModel:
    """A box whose half turns keep its shape, finely divided, with smooth random colours."""
    shape = trimesh.creation.box((0.06, 0.10, 0.15))
    fine = trimesh.Trimesh(*trimesh.remesh.subdivide_to_size(shape.vertices, shape.faces, 0.02))
    points = np.array(fine.vertices)
    waves = np.random.default_rng(seed).normal(scale=60.0, size=(3, 3))
    colors = (120 + 80 * np.sin(points @ waves + [0.3, 1.1, 2.0])).astype(np.uint8)
    mesh = Mesh(points, np.array(fine.faces), colors, np.array(fine.vertex_normals))
    return ObjectModel(1, "box", mesh, mesh, 0.19, np.eye(4)[None], 0.1, 0.04, HALF_TURNS)


@share_of_examples(4)
@given(rotations(), numbers(0.4, 0.9), SEEDS, st.integers(0, 3))
def test_the_start_does_not_decide_which_sibling_is_chosen(rotation, distance, seed, begun):
    model = painted_box(seed)
    pose = rigid(rotation, np.array([0.01, -0.02, distance]))
    rgb, depth, _ = render_scene([(model.mesh, pose)], CAMERA, SHAPE, FRONTAL_LIGHT)
    observation = observe(rgb, depth.astype(np.float32), CAMERA, VerificationSettings())
    first, second = (
        choose_by_texture(observation, model, pose @ motion) for motion in (ALL[0], ALL[begun])
    )
    np.testing.assert_allclose(first, second, atol=1e-9)
    assert np.abs(pose @ ALL - first).max(axis=(1, 2)).min() < 1e-9
    assert rotation_distance(first[:3, :3], rotation) < 1e-6  # nothing blurs it
    # No sibling is near, so that a tracked object is not turned over.
    turned = pose @ ALL[begun]
    assert choose_nearby_by_texture(observation, model, turned) is turned
