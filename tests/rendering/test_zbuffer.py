"""The fast z-buffer against the reference rasteriser: pixels, depths and the faces seen."""

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation

from hlp.geometry import project, rigid, transform
from hlp.rendering.rasterizer import fill_triangles
from hlp.rendering.zbuffer import (
    KernelMesh,
    draw_triangles,
    framed_buffer,
    prepare_mesh,
    project_vertices,
)
from refinement_scene import as_mesh

CAMERA = np.array([[60.0, 0.0, 20.3], [0.0, 62.0, 17.8], [0.0, 0.0, 1.0]])
HEIGHT, WIDTH = 37, 43


def drawn(vertices, faces, pose, cull):
    """Inverse depths and faces seen: of the fast z-buffer, then of the reference."""
    project_vertices(pose, vertices.T.copy(), CAMERA, corners := np.empty((3, len(vertices))))
    fast = framed_buffer(HEIGHT, WIDTH)
    seen = np.full(fast.shape, -1, dtype=np.int32)
    draw_triangles(corners.astype("f4"), KernelMesh(vertices.T.copy(), faces, cull), fast, seen)
    inside = slice(1, HEIGHT + 1), slice(1, WIDTH + 1)
    frame = np.ones(fast.shape, dtype=bool)
    frame[inside] = False
    assert np.isinf(fast[frame]).all() and (seen[frame] == -1).all()
    depth, owner = np.zeros((HEIGHT, WIDTH)), np.full((HEIGHT, WIDTH), -1, dtype=np.int32)
    points = transform(pose, vertices)
    projected = np.column_stack([project(points, CAMERA), 1.0 / points[:, 2]])
    fill_triangles(projected, faces, depth, owner, 0)
    return fast[inside], seen[inside], depth, owner


@pytest.mark.parametrize(("subdivisions", "z"), [(0, 1.3), (1, 1.3), (3, 1.3), (5, 1.3), (4, 0.04)])
@pytest.mark.parametrize("cull", [False, True])
def test_pixels_depths_and_faces_are_those_of_the_reference(subdivisions, z, cull):
    """Triangles from many pixels wide to far below one, or slivers, half of the poses cut off."""
    ball = trimesh.creation.icosphere(subdivisions=subdivisions, radius=0.1)
    ball.apply_scale([1.0, 0.7, z])
    faces = np.array(ball.faces, dtype=np.int32)
    rng = np.random.default_rng(subdivisions)
    differing = covered = 0
    for k in range(20):
        middle = rng.uniform([-0.1, -0.1, 0.4], [0.1, 0.1, 0.6]) * (1 + k % 2)
        pose = rigid(Rotation.random(random_state=rng).as_matrix(), middle)
        fast, seen, depth, owner = drawn(np.array(ball.vertices), faces, pose, cull)
        both = (fast > 0) & (depth > 0)
        np.testing.assert_allclose(fast[both], depth[both], rtol=1e-5)
        differing += np.count_nonzero((fast > 0) != (depth > 0))
        # Where two faces meet, single precision may decide for the other.
        differing += np.count_nonzero(seen[both] != owner[both])
        np.testing.assert_array_equal(seen >= 0, fast > 0)
        covered += np.count_nonzero(both)
    assert covered > 2000
    assert differing <= 0.002 * covered


def test_a_closed_mesh_is_known_whether_its_faces_share_vertices_or_not():
    ball = trimesh.creation.icosphere(subdivisions=2)
    shared = prepare_mesh(as_mesh(ball))
    ball.unmerge_vertices()
    apart = prepare_mesh(as_mesh(ball))
    assert len(ball.vertices) == 3 * len(ball.faces) and apart.closed
    for one, other in zip(shared, apart, strict=True):
        np.testing.assert_array_equal(one, other)


def test_closed_is_a_mesh_with_four_faces_at_an_edge_not_one_with_a_hole_or_inside_out():
    cube = trimesh.creation.box((0.1, 0.1, 0.1))
    two = trimesh.util.concatenate([cube, cube.copy().apply_translation((0.1, 0.1, 0.0))])
    holed = trimesh.Trimesh(two.vertices, two.faces[1:])
    cube.invert()
    assert [prepare_mesh(as_mesh(m)).closed for m in (two, holed, cube)] == [True, False, False]


def test_the_nearest_face_is_seen_and_lanes_spill_nowhere():
    """A triangle of one pixel at the right border: the lanes beyond it draw nothing."""
    corners = np.float32([[WIDTH - 1.4, WIDTH - 0.6, WIDTH - 1.0], [4.6, 4.6, 5.4], [1, 1, 1]])
    both = np.hstack([corners, corners * np.float32([[1], [1], [2]])])
    faces = np.array([[0, 1, 2], [3, 4, 5], [0, 1, 2]], dtype=np.int32)
    buffer = framed_buffer(HEIGHT, WIDTH)
    seen = np.full(buffer.shape, -1, dtype=np.int32)
    draw_triangles(both, KernelMesh(both.astype(float), faces, False), buffer, seen)
    assert np.argwhere(seen >= 0).tolist() == [[6, WIDTH]]
    assert seen[6, WIDTH] == 1 and buffer[6, WIDTH] == 2.0
