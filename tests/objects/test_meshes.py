"""Meshes: loading, decimation, diameters; files that are none."""

import os
import struct
import time

import cv2
import numpy as np
import pytest
import trimesh
from PIL import Image
from scipy.spatial.distance import pdist

from bad_input import check, of_file, written
from hlp.objects import meshes
from hlp.objects.mesh_colors import PLAIN_COLOR
from hlp.objects.meshes import decimate, load_mesh, mesh_diameter
from hlp.records import Mesh


def _export(path, mesh):
    path.write_bytes(mesh.export(file_type=path.suffix[1:]))
    return path


def _sphere_mm(subdivisions=3):
    return trimesh.creation.icosphere(subdivisions, 50.0)


def test_vertices_keep_their_order_in_metres_with_colours(tmp_path):
    sphere = _sphere_mm()
    order = np.random.default_rng(0).permutation(len(sphere.vertices))
    vertices = sphere.vertices[order]
    faces = np.argsort(order)[sphere.faces]
    colors = np.random.default_rng(1).integers(0, 256, (len(vertices), 3)).astype(np.uint8)
    shuffled = trimesh.Trimesh(vertices, faces, vertex_colors=colors, process=False)
    mesh = load_mesh(_export(tmp_path / "a.ply", shuffled))
    np.testing.assert_allclose(mesh.vertices, vertices * 1e-3, atol=1e-8)
    np.testing.assert_array_equal(mesh.faces, faces)
    np.testing.assert_array_equal(mesh.colors, colors)


def test_without_colours_it_is_plain_and_normals_are_computed(tmp_path):
    mesh = load_mesh(_export(tmp_path / "a.ply", _sphere_mm()))
    np.testing.assert_array_equal(mesh.colors, np.tile(PLAIN_COLOR, (len(mesh.vertices), 1)))
    outward = mesh.vertices / np.linalg.norm(mesh.vertices, axis=1, keepdims=True)
    np.testing.assert_allclose(mesh.normals, outward, atol=0.02)
    np.testing.assert_allclose(np.linalg.norm(mesh.normals, axis=1), 1.0, atol=1e-12)


def test_the_files_own_normals_win_and_get_unit_length(tmp_path):
    lines = "0 0 0 0 3 0\n100 0 0 0 0 2\n0 100 0 4 0 0"
    text = ply(lines, "3 0 1 2", ("x", "y", "z", "nx", "ny", "nz"))
    mesh = load_mesh(written(tmp_path / "a.ply", text))
    np.testing.assert_allclose(mesh.normals, [[0, 1, 0], [0, 0, 1], [1, 0, 0]])


def test_a_vertex_without_triangles_gets_a_normal_of_unit_length(tmp_path):
    sphere = _sphere_mm(1)
    loose = trimesh.Trimesh([*sphere.vertices, [0, 0, 0]], sphere.faces, process=False)
    mesh = load_mesh(_export(tmp_path / "a.ply", loose))
    np.testing.assert_array_equal(mesh.normals[-1], [0, 0, 1])


def test_colours_of_faces_reach_the_vertices(tmp_path):
    box = trimesh.creation.box((50, 60, 70))
    box.visual.face_colors = [200, 30, 40, 255]
    mesh = load_mesh(_export(tmp_path / "a.ply", box))
    np.testing.assert_array_equal(mesh.colors, np.tile([200, 30, 40], (8, 1)))


def _mesh(raw, scale=0.001):
    colors = np.zeros((len(raw.vertices), 3), np.uint8)
    colors[:, 0] = np.where(raw.vertices[:, 2] > 0, 250, 5)
    vertices, faces = np.array(raw.vertices) * scale, np.array(raw.faces, dtype=np.int32)
    return Mesh(vertices, faces, colors, np.array(raw.vertex_normals))


def test_a_decimated_mesh_stays_close_and_keeps_colours_and_outward_normals():
    full = _mesh(_sphere_mm(5))
    small = decimate(full, 500)
    assert 400 <= len(small.faces) <= 500
    surface = trimesh.Trimesh(small.vertices, small.faces, process=False)
    _, distance, _ = trimesh.proximity.closest_point_naive(surface, full.vertices[::100])
    assert distance.max() < 0.002
    far = np.abs(small.vertices[:, 2]) > 0.005
    np.testing.assert_array_equal(small.colors[far, 0] == 250, small.vertices[far, 2] > 0)
    assert np.einsum("ij,ij->i", small.normals, small.vertices).min() > 0.04
    np.testing.assert_allclose(np.linalg.norm(small.normals, axis=1), 1.0)


def _soup(corners):
    """Triangles (n, 3, 3) that share no vertex."""
    faces = np.arange(3 * len(corners)).reshape(-1, 3)
    return trimesh.Trimesh(corners.reshape(-1, 3), faces, process=False)


def test_decimating_a_triangle_soup_does_not_tear_it():
    small = decimate(_mesh(_soup(_sphere_mm(4).triangles)), 600)
    assert trimesh.Trimesh(small.vertices, small.faces).is_watertight


@pytest.mark.parametrize("thickness", [0.5, 0.0])  # something flat has no convex hull
def test_the_diameter_is_the_largest_of_all_distances(thickness):
    points = np.random.default_rng(0).normal(size=(400, 3)) * [1, 2, thickness]
    assert mesh_diameter(points) == pytest.approx(pdist(points).max(), rel=1e-12)


def _subdivided(mesh, least):
    while len(mesh.faces) < least:
        mesh = mesh.subdivide()
    return mesh


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["sphere", "torn box", "soup"])
def test_a_mesh_of_a_million_triangles_gets_few_faces_soon(kind):
    """Coplanar triangles and open edges are what simplifying by quadric error stops at."""
    raw = trimesh.creation.box((60, 90, 120)) if kind == "torn box" else _sphere_mm(4)
    raw = _subdivided(raw, 600_000 if kind == "soup" else 1_000_000)
    if kind == "torn box":  # one sixth of the triangles are missing, here and there
        raw.update_faces(np.random.default_rng(0).random(len(raw.faces)) > 1 / 6)
    if kind == "soup":
        raw = _soup(raw.triangles)
    full = _mesh(raw)
    begun = time.process_time()
    small = decimate(full, 500)
    assert time.process_time() - begun < 20.0
    assert 100 <= len(small.faces) <= 500
    np.testing.assert_allclose(np.ptp(small.vertices, axis=0), np.ptp(full.vertices, axis=0), 0.05)


def test_vertices_of_large_meshes_are_merged_in_cells(monkeypatch):
    """Also triangles that share no edge, at which quadric error may stop early."""
    monkeypatch.setattr(meshes, "_VERY_LARGE", 1000)
    rng = np.random.default_rng(0)
    corners = rng.random((3000, 1, 3)) * 100.0 + rng.normal(size=(3000, 3, 3))
    for raw in (_soup(corners), _sphere_mm(5)):
        small = decimate(_mesh(raw), 500)
        assert 4 <= len(small.faces) <= 500
        np.testing.assert_allclose(np.ptp(small.vertices, 0), np.ptp(raw.vertices, 0) / 1e3, 0.1)


def test_parts_of_a_scene_keep_their_colours_when_one_has_a_texture(tmp_path):
    textured = trimesh.creation.box((30, 30, 30))
    image = Image.fromarray(np.full((8, 8, 3), (10, 200, 30), np.uint8))
    uv = np.zeros((len(textured.vertices), 2))
    textured.visual = trimesh.visual.TextureVisuals(uv=uv, image=image)
    painted = trimesh.creation.box(
        (20, 20, 20), transform=trimesh.transformations.translation_matrix([60, 0, 0])
    )
    painted.visual.vertex_colors = [200, 30, 40, 255]
    path = tmp_path / "a.glb"
    path.write_bytes(trimesh.Scene([textured, painted]).export(file_type="glb"))
    mesh = load_mesh(path)
    right = mesh.vertices[:, 0] > 0.04
    assert mesh.colored and right.any() and (~right).any()
    assert np.abs(mesh.colors[right] - np.array([200, 30, 40])).max() <= 2
    assert np.abs(mesh.colors[~right] - np.array([10, 200, 30])).max() <= 2


def test_open_and_far_off_meshes_are_accepted(tmp_path):
    cap = trimesh.Trimesh(_sphere_mm().vertices, _sphere_mm().faces[:300], process=False)
    cap.apply_translation([5000, 0, 0])
    mesh = load_mesh(_export(tmp_path / "a.stl", cap))
    assert len(mesh.faces) == 300 and mesh.vertices[:, 0].min() > 4.9


@pytest.mark.parametrize(("size", "scale"), [(0.12, 1.0), (120.0, 0.001), (15.0, 0.001)])
def test_the_unit_is_guessed_and_said(tmp_path, caplog, size, scale):
    path = _export(tmp_path / "a.ply", trimesh.creation.box((size, size / 2, size / 2)))
    with caplog.at_level("INFO", "hlp"):
        mesh = load_mesh(path, None)
    assert np.ptp(mesh.vertices[:, 0]) == pytest.approx(size * scale, rel=1e-5)
    assert f"mesh_scale={scale:g}" in caplog.text
    warned = [record.getMessage() for record in caplog.records if record.levelname == "WARNING"]
    assert [item.count("the mesh is in centimetres") for item in warned] == [1] * (size == 15.0)


def test_a_size_that_fits_no_unit_asks_for_it(tmp_path):
    path = _export(tmp_path / "a.ply", trimesh.creation.box((3.0, 4.0, 5.0)))
    with pytest.raises(ValueError, match=r"a\.ply is 7\.071 units large.*give mesh_scale"):
        load_mesh(path, None)
    assert np.ptp(load_mesh(path, 0.01).vertices[:, 2]) == pytest.approx(0.05)


def test_the_diameter_of_very_many_corners_is_right_to_a_thousandth():
    """All vertices of an ellipsoid are corners of its hull: not every pair is compared."""
    vertices = trimesh.creation.icosphere(6, 50.0).vertices * [1.0, 1.3, 0.8]
    assert len(vertices) > 40_000
    exact = 130.0  # its longest axis, up to the distance of vertices
    assert exact * 0.999 <= mesh_diameter(vertices) <= exact


@pytest.mark.slow
def test_a_mesh_of_a_million_triangles_is_decimated_when_it_is_loaded(tmp_path):
    path = _export(tmp_path / "a.ply", trimesh.creation.icosphere(8, 50.0))
    mesh = load_mesh(path)
    assert 50_000 < len(mesh.faces) <= 100_000
    np.testing.assert_allclose(np.linalg.norm(mesh.vertices, axis=1), 0.05, atol=2e-4)
    np.testing.assert_allclose(np.linalg.norm(mesh.normals, axis=1), 1.0, atol=1e-6)


BOX = trimesh.creation.box((70, 80, 90))


def mesh(name, content):
    return of_file(load_mesh, name, content)


def ply(vertices, face, columns=("x", "y", "z")):
    """A mesh of three vertices and one face."""
    properties = "".join(f"property float {name}\n" for name in columns)
    return (
        f"ply\nformat ascii 1.0\nelement vertex 3\n{properties}"
        f"element face 1\nproperty list uchar int vertex_indices\nend_header\n{vertices}\n{face}\n"
    )


@pytest.mark.parametrize("name", ["a.mtl", "a.png"])
def test_a_pipe_that_a_mesh_names_is_not_waited_for(tmp_path, name):
    written(tmp_path / "a.mtl", "newmtl a\nmap_Kd a.png\n")
    (tmp_path / name).unlink(missing_ok=True)
    os.mkfifo(tmp_path / name)
    text = "mtllib a.mtl\nusemtl a\nv 0 0 0\nv 90 0 0\nv 0 90 0\nv 0 0 70\nvt 0 0\n"
    text += "f 1/1 2/1 3/1\nf 1/1 2/1 4/1\nf 1/1 3/1 4/1\nf 2/1 3/1 4/1\n"
    assert load_mesh(written(tmp_path / "a.obj", text)).texture is None


def textured_mesh(uv):
    """A tetrahedron with a texture, one of whose corners has these texture coordinates."""

    def read(folder):
        pixels = np.arange(48, dtype=np.uint8).reshape(4, 4, 3)
        written(folder / "a.png", cv2.imencode(".png", pixels)[1].tobytes())
        written(folder / "a.mtl", "newmtl a\nmap_Kd a.png\n")
        corners = "v 0 0 0\nv 90 0 0\nv 0 90 0\nv 0 0 70\nvt 0 0\nvt 1 0\nvt 0 1\n"
        faces = "f 1/1 2/2 3/3\nf 1/1 2/2 4/4\nf 1/1 3/3 4/4\nf 2/2 3/3 4/4\n"
        text = f"mtllib a.mtl\n{corners}vt {uv}\nusemtl a\n{faces}"
        return load_mesh(written(folder / "a.obj", text))

    return read


BINARY_PLY = bytes(BOX.export(file_type="ply"))
CORNERS = "0 0 0\n90 0 0\n0 90 0"
TINY = trimesh.creation.box((0.07, 0.08, 0.09))
MESHES = {
    "no mesh": (lambda folder: load_mesh(folder / "a.ply"), "no mesh"),
    "ply: empty": (mesh("a.ply", ""), "cannot be read as a mesh"),
    "ply: header alone": (mesh("a.ply", BINARY_PLY[:60]), "cannot be read as a mesh"),
    "ply: a face of vertex 9": (mesh("a.ply", ply(CORNERS, "3 0 1 9")), "vertex"),
    "ply: NaN": (mesh("a.ply", ply("nan 0 0\n90 0 0\n0 90 0", "3 0 1 2")), "NaN or infinite"),
    "ply: metres": (mesh("a.ply", TINY.export(file_type="ply")), "probably the wrong unit"),
    "obj: no faces": (mesh("a.obj", "v 0 0 0\nv 90 0 0\nv 0 90 0\n"), "no triangles"),
    "obj: a face of vertex 9": (mesh("a.obj", "v 0 0 0\nv 90 0 0\nv 0 90 0\nf 1 2 9\n"), "a.obj"),
    "stl: many stated": (mesh("a.stl", b"\0" * 80 + struct.pack("<I", 2**31)), "a.stl"),
    "obj: texture coordinates": (textured_mesh("1e30 -1e30"), "has texture coordinates beyond"),
    "ply: points for triangles": (mesh("a.ply", ply(CORNERS, "3 1 1 1")), "has no surface"),
    "ply: a line": (mesh("a.ply", ply("0 0 0\n9 0 0\n90 0 0", "3 0 1 2")), "no surface"),
    "dae without its package": (mesh("a.dae", "<COLLADA/>"), "a.dae cannot be read as a mesh"),
    "mesh without extension": (mesh("a", BINARY_PLY), "cannot be read as a mesh"),
}


@pytest.mark.parametrize("case", MESHES)
def test_what_is_no_mesh_is_said_by_an_error_of_our_own(tmp_path, case):
    check(MESHES[case], tmp_path)
