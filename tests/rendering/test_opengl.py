"""OpenGL draws what the numba rasteriser draws, pixel for pixel; each known trap has its test."""

import gc
import textwrap
import threading
from dataclasses import replace

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation

from hlp.geometry import rigid
from hlp.records import Mesh
from hlp.rendering import opengl, rasterizer
from hlp.rendering.shading import Light, random_light
from new_process import printed_by
from refinement_scene import as_mesh

CAMERA = np.array([[300.0, 0.0, 31.3], [0.0, 310.0, 22.6], [0.0, 0.0, 1.0]])
SHAPE = (48, 67)
LIGHT = Light((0.0, 0.6, -0.8), ambient=0.4, diffuse=0.5, specular=0.3, shininess=20.0)


@pytest.fixture
def working_opengl():
    problem = opengl.opengl_problem()
    if problem is not None:
        pytest.skip(problem)


def bumpy_ball(seed=0):
    ball = trimesh.creation.icosphere(subdivisions=3, radius=0.05)
    bumps = np.random.default_rng(seed).uniform(0.8, 1.2, (len(ball.vertices), 1))
    mesh = as_mesh(trimesh.Trimesh(ball.vertices * bumps, ball.faces, process=False))
    colors = np.random.default_rng(seed).integers(0, 256, mesh.colors.shape)
    return replace(mesh, colors=colors.astype(np.uint8))


def random_poses(count):
    rng = np.random.default_rng(1)
    places = rng.uniform([-0.02, -0.02, 0.4], [0.02, 0.02, 0.8], (count, 3))
    return rigid(Rotation.random(count, random_state=rng).as_matrix(), places)


def at(z):
    return trimesh.transformations.translation_matrix([0, 0, z])


def assert_same_pictures(mesh, poses, camera, shape):
    rng = np.random.default_rng(2)
    depth_gaps, color_gaps, silhouette = [], [], []
    for pose in poses:
        light = random_light(rng)
        rgb, depth = opengl.render_rgbd(mesh, pose, camera, shape, light)
        rgb_ref, depth_ref = rasterizer.render_rgbd(mesh, pose, camera, shape, light)
        assert rgb.shape == (*shape, 3) and rgb.dtype == np.uint8
        assert depth.shape == shape and depth.dtype == np.float32
        assert (rgb[depth == 0] == 0).all()
        shared = (depth > 0) & (depth_ref > 0)
        depth_gaps.append(np.abs(depth - depth_ref)[shared])
        color_gaps.append(np.abs(rgb.astype(int) - rgb_ref)[shared].max(axis=1))
        silhouette.append(np.mean((depth > 0) != (depth_ref > 0)))
    assert sum(len(gap) for gap in depth_gaps) > 1000
    assert np.mean(np.concatenate(depth_gaps) < 1e-5) >= 0.999
    assert np.mean(np.concatenate(color_gaps) <= 1) >= 0.999
    assert np.mean(silhouette) < 1e-3


@pytest.mark.usefixtures("working_opengl")
class TestPictures:
    def test_agrees_with_the_numba_rasterizer(self):
        assert_same_pictures(bumpy_ball(), random_poses(20), CAMERA, SHAPE)

    def test_back_faces_are_drawn(self):
        corners = np.array([[-0.05, -0.05, 0.0], [0.05, -0.05, 0.0], [0.0, 0.05, 0.0]])
        pictures = []
        for order in ([0, 1, 2], [0, 2, 1]):
            mesh = Mesh(
                corners,
                np.array([order]),
                np.full((3, 3), 200, np.uint8),
                np.tile([0.0, 0, 1], (3, 1)),
            )
            pictures.append(opengl.render_rgbd(mesh, at(0.5), CAMERA, SHAPE, LIGHT))
        assert (pictures[0][1] > 0).sum() > 500
        np.testing.assert_array_equal(pictures[0][1], pictures[1][1])
        np.testing.assert_array_equal(pictures[0][0], pictures[1][0])

    def test_sizes_and_meshes_may_change_from_call_to_call(self):
        meshes = [bumpy_ball(seed) for seed in range(3)]
        first = opengl.render_rgbd(meshes[0], at(0.5), CAMERA, SHAPE, LIGHT)
        others = [opengl.render_rgbd(mesh, at(0.5), CAMERA, (9, 7), LIGHT)[0] for mesh in meshes]
        assert all((others[0] != other).any() for other in others[1:])
        gc.collect()
        again = opengl.render_rgbd(meshes[0], at(0.5), CAMERA, SHAPE, LIGHT)
        np.testing.assert_array_equal(first[0], again[0])
        np.testing.assert_array_equal(first[1], again[1])

    def test_an_object_behind_the_camera_is_not_seen(self):
        rgb, depth = opengl.render_rgbd(bumpy_ball(), at(-0.5), CAMERA, SHAPE, LIGHT)
        assert not rgb.any() and not depth.any()

    def test_another_thread_is_told_why_it_cannot_render(self):
        problems = []
        thread = threading.Thread(target=lambda: problems.append(opengl.opengl_problem()))
        thread.start()
        thread.join()
        assert problems[0] is not None and "thread" in problems[0]
        assert opengl.opengl_problem() is None  # here it still works


@pytest.mark.usefixtures("working_opengl")
def test_a_forked_child_is_told_why_it_cannot_render():
    code = """
        import os
        from hlp.rendering.opengl import opengl_problem
        assert opengl_problem() is None
        if os.fork() == 0:
            print(opengl_problem(), flush=True)
            os._exit(0)
        os.wait()
    """
    printed = printed_by(textwrap.dedent(code))
    assert "forked" in printed and "spawn" in printed


def test_missing_libraries_are_named():
    code = """
        import sys
        sys.modules["pyrender"] = None  # importing it raises ImportError
        from hlp.rendering.opengl import opengl_problem, render_rgbd
        assert opengl_problem() is not None
        try:
            render_rgbd(None, None, None, (1, 1), None)
        except RuntimeError as error:
            print(error)
    """
    printed = printed_by(textwrap.dedent(code))
    assert "libegl1 libgl1 libxrender1" in printed
