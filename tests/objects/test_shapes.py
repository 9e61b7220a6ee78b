import numpy as np
import pytest
import trimesh

from hlp.objects import shapes

GREY = (120, 120, 120)


def as_trimesh(mesh):
    return trimesh.Trimesh(mesh.vertices, mesh.faces, process=False)


@pytest.mark.parametrize(
    ("mesh", "volume"),
    [
        (shapes.cylinder(0.03, 0.1, GREY), np.pi * 0.03**2 * 0.1),
        (shapes.ellipsoid((0.03, 0.04, 0.05), GREY), 4 / 3 * np.pi * 0.03 * 0.04 * 0.05),
        (shapes.rounded_box((0.04, 0.06, 0.08), 0.001, GREY), 0.04 * 0.06 * 0.08),
        (shapes.tube([(0, 0, 0), (0, 0.1, 0)], (0.01, 0.01), GREY), np.pi * 0.01**2 * 0.1),
        (shapes.lathe([(0, 0), (0.04, 0), (0, 0.09)], GREY), np.pi * 0.04**2 * 0.03),
    ],
    ids=["cylinder", "ellipsoid", "box", "tube", "cone"],
)
def test_shapes_are_closed_and_enclose_their_volume(mesh, volume):
    solid = as_trimesh(mesh)
    assert solid.is_watertight
    assert solid.is_winding_consistent
    assert solid.volume == pytest.approx(volume, rel=0.07)
    assert solid.edges_unique_length.max() < 1.6 * shapes.SPACING * np.sqrt(2)


@pytest.mark.parametrize("rounding", [0.002, 0.01, 0.02])
def test_rounded_box_has_its_size_and_rounded_corners(rounding):
    mesh = shapes.rounded_box((0.04, 0.06, 0.08), rounding, GREY)
    np.testing.assert_allclose(np.ptp(mesh.vertices, axis=0), (0.04, 0.06, 0.08), atol=1e-12)
    corner = np.array([0.02, 0.03, 0.04])
    nearest = np.linalg.norm(mesh.vertices - corner, axis=1).min()
    assert nearest >= (np.sqrt(3) - 1) * rounding - 1e-9


def test_ellipsoid_normals_are_those_of_its_gradient():
    radii = np.array([0.03, 0.04, 0.05])
    mesh = shapes.ellipsoid(radii, GREY)
    gradient = mesh.vertices / radii**2
    gradient /= np.linalg.norm(gradient, axis=1, keepdims=True)
    assert np.einsum("ij,ij->i", gradient, mesh.normals).min() > np.cos(np.radians(3))


def test_moved_turns_then_shifts_vertices_and_normals():
    mesh = shapes.cylinder(0.01, 0.1, GREY)
    lying = shapes.moved(mesh, (0.0, 0.0, 1.0), (0, 90, 0))
    np.testing.assert_allclose(lying.vertices[:, 0], mesh.vertices[:, 2], atol=1e-12)
    np.testing.assert_allclose(lying.vertices[:, 2], 1.0 - mesh.vertices[:, 0], atol=1e-12)
    np.testing.assert_allclose(lying.normals[:, 0], mesh.normals[:, 2], atol=1e-12)


def test_merge_keeps_triangles_and_colors_of_each_part():
    red = shapes.ellipsoid((0.01, 0.01, 0.01), (200, 0, 0))
    blue = shapes.moved(shapes.cylinder(0.01, 0.02, (0, 0, 200)), (1.0, 0.0, 0.0))
    both = shapes.merge(red, blue)
    assert len(both.faces) == len(red.faces) + len(blue.faces)
    corner = both.vertices[both.faces[:, 0]]
    expected = np.where(corner[:, :1] > 0.5, [0, 0, 200], [200, 0, 0])
    np.testing.assert_array_equal(both.colors[both.faces[:, 0]], expected)
