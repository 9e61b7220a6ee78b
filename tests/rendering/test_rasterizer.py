"""Depth and colours against closed forms, and against a ray caster written here."""

from dataclasses import replace

import numpy as np
import pytest
import trimesh
from hypothesis import given
from hypothesis import strategies as st

from generated_values import SEEDS, numbers
from hlp.geometry import rigid
from hlp.records import Mesh
from hlp.rendering.rasterizer import render_depth, render_rgbd, render_scene
from hlp.rendering.shading import Light
from refinement_scene import as_mesh

CAMERA = np.array([[70.0, 0.0, 31.3], [0.0, 72.0, 24.6], [0.0, 0.0, 1.0]])
SHAPE = (48, 64)
AMBIENT = Light((0.0, 0.0, -1.0), ambient=1.0, diffuse=0.0, specular=0.0, shininess=1.0)


def random_pose(rng, z):
    rotation = trimesh.transformations.random_rotation_matrix(rng.random(3))[:3, :3]
    return rigid(rotation, np.array([*rng.uniform(-0.05, 0.05, 2), z]))


def rays(shape):
    """Ray through each pixel centre, z = 1 (by the camera's definition, not by our code)."""
    y, x = np.mgrid[: shape[0], : shape[1]]
    return np.stack(
        [(x - CAMERA[0, 2]) / CAMERA[0, 0], (y - CAMERA[1, 2]) / CAMERA[1, 1], np.ones(shape)],
        axis=-1,
    )


def test_no_cracks_between_neighbouring_triangles():
    """A fine jittered grid, edges of it along pixel rows, covers every pixel, from both sides."""
    rng = np.random.default_rng(0)
    side = np.linspace(-1.0, 1.0, 60)
    x, y = np.meshgrid(side, side)
    x[1:-1, 1:-1] += rng.uniform(-0.01, 0.01, (58, 58))
    vertices = np.stack([x, y, np.zeros_like(x)], axis=-1).reshape(-1, 3)
    corner = (np.arange(59)[:, None] * 60 + np.arange(59)).ravel()
    faces = np.concatenate(
        [
            np.stack([corner, corner + 1, corner + 61], axis=1),
            np.stack([corner, corner + 61, corner + 60], axis=1),
        ]
    )
    mesh = Mesh(vertices, faces, np.zeros((3600, 3), np.uint8), np.ones((3600, 3)))
    camera = np.array([[59.0, 0.0, 32.0], [0.0, 59.0, 24.0], [0.0, 0.0, 1.0]])
    flipped = np.diag([1.0, -1.0, -1.0])
    poses = np.stack([rigid(r, np.array([0.0, 0.0, 1.0])) for r in (np.eye(3), flipped)])
    depth = render_depth(mesh, poses, camera, SHAPE)
    np.testing.assert_allclose(depth, 1.0, rtol=1e-6)


def test_neither_threads_nor_batch_nor_the_box_that_is_drawn_change_a_bit_of_the_depth():
    """Some are cut off by a border; a scene is drawn in the whole image."""
    rng = np.random.default_rng(3)
    mesh = as_mesh(trimesh.creation.torus(0.06, 0.02))
    poses = np.stack([random_pose(rng, 0.4) for _ in range(8)])
    poses[::2, :2, 3] *= 5.0
    whole = np.stack([render_rgbd(mesh, pose, CAMERA, SHAPE, AMBIENT)[1] for pose in poses])
    one = render_depth(mesh, poses, CAMERA, SHAPE, threads=1)
    two = render_depth(mesh, poses, CAMERA, SHAPE, threads=2)
    alone = np.concatenate([render_depth(mesh, pose[None], CAMERA, SHAPE) for pose in poses])
    assert (whole > 0.0).any(axis=(1, 2)).all()
    for other in (two, alone, whole):
        np.testing.assert_array_equal(one, other)


def test_triangles_behind_or_at_the_camera_are_not_drawn():
    mesh = as_mesh(trimesh.creation.icosphere(subdivisions=1, radius=0.05))
    poses = np.stack([rigid(np.eye(3), np.array([0.0, 0.0, z])) for z in (-0.5, 0.0)])
    depth = render_depth(mesh, poses, CAMERA, SHAPE)
    assert (depth[0] == 0).all()
    assert np.isfinite(depth).all()


def test_vertex_colours_are_interpolated_perspective_correctly():
    """Colour = position on a strongly tilted plane; its value follows the 3D point, not the 2D."""
    square = np.array([[-1.0, -1.0, 0.0], [1.0, -1.0, 0.0], [1.0, 1.0, 0.0], [-1.0, 1.0, 0.0]])
    colors = np.array([[0, 0, 9], [250, 0, 9], [250, 250, 9], [0, 250, 9]], dtype=np.uint8)
    mesh = Mesh(square, np.array([[0, 1, 2], [0, 2, 3]]), colors, np.tile([0.0, 0.0, 1.0], (4, 1)))
    tilt = trimesh.transformations.rotation_matrix(0.9, [0.0, 1.0, 0.0])[:3, :3]
    pose = rigid(tilt, np.array([0.0, 0.0, 1.5]))
    rgb, depth = render_rgbd(mesh, pose, CAMERA, SHAPE, AMBIENT)
    seen = depth > 0
    point = (rays(SHAPE)[seen] * depth[seen][:, None] - pose[:3, 3]) @ tilt
    assert seen.sum() > 500
    np.testing.assert_allclose(rgb[seen][:, 0], 125.0 * (point[:, 0] + 1.0), atol=0.6)
    np.testing.assert_allclose(rgb[seen][:, 1], 125.0 * (point[:, 1] + 1.0), atol=0.6)
    assert (rgb[~seen] == 0).all()


def test_scene_keeps_the_nearest_part_and_names_it():
    rng = np.random.default_rng(5)
    meshes = [
        as_mesh(trimesh.creation.icosphere(subdivisions=2, radius=0.06), (250, 0, 0)),
        as_mesh(trimesh.creation.box((0.1, 0.08, 0.1)), (0, 250, 0)),
    ]
    # As some versions of trimesh lay them out.
    meshes[0] = replace(meshes[0], normals=np.asfortranarray(meshes[0].normals))
    poses = [random_pose(rng, 0.4), random_pose(rng, 0.42)]
    rgb, depth, index = render_scene(list(zip(meshes, poses, strict=True)), CAMERA, SHAPE, AMBIENT)
    alone = np.stack(
        [
            render_depth(mesh, pose[None], CAMERA, SHAPE)[0]
            for mesh, pose in zip(meshes, poses, strict=True)
        ]
    )
    distance = np.where(alone > 0, alone, np.inf)
    nearest = np.where((alone > 0).any(axis=0), distance.argmin(axis=0), -1)
    np.testing.assert_array_equal(index, nearest)
    np.testing.assert_array_equal(depth, np.where(nearest >= 0, distance.min(axis=0), 0))
    assert min((index == part).sum() for part in (0, 1)) > 50
    assert (rgb[index == 0] == [250, 0, 0]).all() and (rgb[index == 1] == [0, 250, 0]).all()


def test_bad_input_is_named():
    mesh = as_mesh(trimesh.creation.box((0.1, 0.1, 0.1)))
    poses = np.stack([rigid(np.eye(3), np.array([0.0, 0.0, 0.5]))] * 3)
    poses[1, 0, 3] = np.nan
    with pytest.raises(ValueError, match=r"poses_cam_obj\[1\]"):
        render_depth(mesh, poses, CAMERA, SHAPE)


SMALL = (24, 32)
CLEAR = 1e-6  # barycentric; nearer to an edge than this, a pixel may count as inside or outside


def cast(mesh, camera):
    """Depth (rays, triangles) where a ray hits for certain, and where it may; else infinite."""
    y, x = np.mgrid[: SMALL[0], : SMALL[1]].reshape(2, -1)
    focal, middle = camera[[0, 1], [0, 1]], camera[:2, 2]
    rays = np.column_stack([(np.column_stack([x, y]) - middle) / focal, np.ones(len(x))])
    corners = mesh.vertices[mesh.faces]
    # A ray r hits the triangle (a, b, c) where [a b c] w = r has only positive weights.
    weights = np.einsum("fij,rj->rfi", np.linalg.inv(np.swapaxes(corners, 1, 2)), rays)
    total = weights.sum(axis=2)
    with np.errstate(divide="ignore", invalid="ignore"):
        least = (weights / total[..., None]).min(axis=2)
        depth = 1.0 / total
    surely = np.where((total > 0) & (least > CLEAR), depth, np.inf)
    perhaps = np.where((total > 0) & (least > -CLEAR), depth, np.inf)
    return surely, perhaps


@st.composite
def triangles(draw):
    """Triangles in front of a camera, some beyond the image's border, none seen edge-on."""
    rng = np.random.default_rng(draw(SEEDS))
    focal = draw(numbers(10.0, 60.0))
    camera = np.array([[focal, 0.0, 15.3], [0.0, focal * 1.1, 11.6], [0.0, 0.0, 1.0]])
    count = draw(st.integers(1, 30))
    z = rng.uniform(0.2, draw(numbers(0.3, 5.0)), (3 * count, 1))
    pixels = rng.uniform(-20, 50, (3 * count, 2))
    vertices = np.hstack([(pixels - camera[:2, 2]) / camera[[0, 1], [0, 1]] * z, z])
    faces = np.arange(3 * count).reshape(-1, 3)
    a, b, c = (pixels[faces[:, i]] for i in range(3))
    area = (b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]
    faces = faces[np.abs(area) > 0.1]
    grey = np.zeros((len(vertices), 3), np.uint8)
    return Mesh(vertices, faces, grey, np.zeros_like(vertices)), camera


@given(triangles())
def test_the_nearest_triangle_is_drawn_at_its_depth(case):
    mesh, camera = case
    if len(mesh.faces) == 0:
        return
    drawn = render_depth(mesh, np.eye(4)[None], camera, SMALL)[0].ravel()
    surely, perhaps = cast(mesh, camera)
    nearest = surely.min(axis=1)
    tolerance = 1e-5 * np.where(np.isfinite(nearest), nearest, 1.0)
    seen = drawn > 0
    assert not (np.isfinite(nearest) & ~seen).any()
    assert (drawn[seen] <= nearest[seen] + tolerance[seen]).all()
    apart = np.abs(perhaps - drawn[:, None]).min(axis=1)
    assert (apart[seen] < 1e-5 * drawn[seen]).all()
