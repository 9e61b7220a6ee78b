"""Near-symmetries of shapes whose symmetries are known."""

import numpy as np
import pytest
import trimesh
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from hlp.geometry import transform
from hlp.objects.meshes import mesh_diameter
from hlp.objects.near_symmetries import CONTINUOUS_STEPS, find_near_symmetries, without
from hlp.records import Mesh

RED, BLUE = (200, 30, 30), (20, 40, 200)


def _mesh(shape, paint=None, colored=False):
    """A shape (mm), turned and shifted so that its axes are nobody's; `paint` of local points."""
    points = np.array(shape.vertices)
    turn = Rotation.from_rotvec([0.4, -0.9, 0.3]).as_matrix()
    colors = np.full((len(points), 3), 128, np.uint8)
    if paint is not None:
        colors = np.where(paint(points)[:, None], RED, BLUE).astype(np.uint8)
    return Mesh(
        (points @ turn.T + [30, -20, 50]) / 1000,
        np.array(shape.faces),
        colors,
        np.array(shape.vertex_normals) @ turn.T,
        colored=colored or paint is not None,
    )


def _find(mesh):
    return find_near_symmetries(mesh, mesh_diameter(mesh.vertices))


def _fine(shape, edge=4.0):
    return trimesh.Trimesh(*trimesh.remesh.subdivide_to_size(shape.vertices, shape.faces, edge))


BOX = trimesh.creation.box((60, 100, 150))
PRISM = trimesh.creation.box((60, 60, 150))
CUBE = trimesh.creation.box((80, 80, 80))
CYLINDER = trimesh.creation.cylinder(35, 120, sections=64)
CONE = trimesh.creation.cone(40, 120, sections=64)
WEDGE = trimesh.Trimesh(
    [[0, 0, 0], [90, 0, 0], [0, 50, 0], [0, 0, 120], [90, 0, 30], [0, 50, 70]]
).convex_hull
TURNS = CONTINUOUS_STEPS - 1


def _mug():
    body = trimesh.creation.cylinder(40, 100, sections=64)
    handle = trimesh.creation.torus(25, 6)
    handle.apply_transform(trimesh.transformations.rotation_matrix(np.pi / 2, [1, 0, 0]))
    handle.apply_translation([48, 0, 0])
    return trimesh.util.concatenate([body, handle])


@pytest.mark.parametrize(
    ("shape", "count"),
    [
        (PRISM, 7),
        (CUBE, 23),
        (CYLINDER, 2 * TURNS + 1),
        (CONE, TURNS),
        (WEDGE, 0),
        (trimesh.creation.cylinder(40, 150, sections=3), 5),
    ],
)
def test_a_shape_without_colours_has_the_symmetries_of_its_shape(shape, count):
    mesh = _mesh(shape)
    found = _find(mesh)
    assert len(found.unbroken) == count and len(found.broken) == 0
    points = _sampled(mesh)
    for motion in found.unbroken[:8]:
        distance, _ = cKDTree(points).query(transform(motion, points))
        assert np.quantile(distance, 0.95) < 0.004  # samples are about 2 mm apart
        np.testing.assert_allclose(motion[:3, :3] @ motion[:3, :3].T, np.eye(3), atol=1e-9)


def _sampled(mesh):
    raw = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False)
    return trimesh.sample.sample_surface(raw, 20_000, seed=0)[0]


def test_a_mugs_handle_breaks_its_axis_but_leaves_the_half_turn_through_it():
    found = _find(_mesh(_mug()))
    assert len(found.unbroken) <= 1  # the turn about the handle's own direction


def test_colours_break_what_they_tell_apart():
    # One half of the box along its longest side is red: only the turn about that side remains.
    found = _find(_mesh(_fine(BOX), lambda points: points[:, 2] > 0))
    assert len(found.unbroken) == 1 and len(found.broken) == 2
    angle = np.degrees(np.linalg.norm(Rotation.from_matrix(found.unbroken[0, :3, :3]).as_rotvec()))
    assert angle == pytest.approx(180.0, abs=0.1)


def test_one_colour_breaks_nothing():
    found = _find(_mesh(_fine(BOX), lambda points: points[:, 2] > -1000))
    assert len(found.unbroken) == 3 and len(found.broken) == 0


@pytest.mark.slow
def test_print_breaks_a_continuous_axis_and_leaves_its_own_turns():
    can = _fine(CYLINDER, 6.0)
    bands = _find(_mesh(can, lambda points: points[:, 2] > 20))
    assert len(bands.unbroken) == TURNS and len(bands.broken) == TURNS + 1
    stripe = _find(_mesh(can, lambda points: points[:, 0] > 10))
    assert len(stripe.unbroken) + len(stripe.broken) == 2 * TURNS + 1
    about_axis = [item for item in stripe.unbroken if np.trace(item[:3, :3]) > -0.99]
    assert about_axis == []
    two = _find(_mesh(can, lambda points: points[:, 0] * points[:, 1] > 0))
    assert len(two.unbroken) >= 1


def test_motions_near_known_ones_are_left_out():
    turns = Rotation.from_rotvec(np.radians([[0, 0, 4], [0, 0, 90], [0, 0, 180]])).as_matrix()
    motions = np.tile(np.eye(4), (3, 1, 1))
    motions[:, :3, :3] = turns
    assert len(without(motions, np.eye(4)[None])) == 2
    assert len(without(motions, motions[1:])) == 1
