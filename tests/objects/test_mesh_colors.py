"""Textures and colours of mesh files."""

import logging

import numpy as np
import pytest
import trimesh
from PIL import Image

from hlp.objects.mesh_colors import PLAIN_COLOR
from hlp.objects.meshes import decimate, load_mesh

IMAGE = np.random.default_rng(0).integers(0, 256, (32, 48, 3)).astype(np.uint8)


def _write(folder, kind):
    """A box with a texture in a file of some kind; the file, and its texture coordinates."""
    box = trimesh.creation.box((50, 60, 70))
    uv = np.random.default_rng(1).random((len(box.vertices), 2))
    if kind == "ply":
        return _write_ply(folder, box, uv), uv
    box.visual = trimesh.visual.TextureVisuals(uv=uv, image=Image.fromarray(IMAGE))
    box.export(folder / f"box.{kind}")
    return folder / f"box.{kind}", uv


def _write_ply(folder, box, uv):
    """As BOP writes textured meshes: an image beside the file, coordinates on the vertices."""
    lines = [
        "ply", "format ascii 1.0", "comment TextureFile box.png",
        f"element vertex {len(uv)}",
        *(f"property float {name}" for name in ("x", "y", "z", "texture_u", "texture_v")),
        f"element face {len(box.faces)}", "property list uchar int vertex_indices", "end_header",
    ]  # fmt: skip
    rows = [" ".join(map(str, row)) for row in np.concatenate([box.vertices, uv], axis=1)]
    faces = [f"3 {a} {b} {c}" for a, b, c in box.faces]
    path = folder / "box.ply"
    path.write_text("\n".join([*lines, *rows, *faces, ""]))
    Image.fromarray(IMAGE).save(folder / "box.png")
    return path


@pytest.mark.parametrize("kind", ["ply", "obj", "glb"])
def test_textures_are_read_at_full_resolution(tmp_path, kind):
    path, uv = _write(tmp_path, kind)
    mesh = load_mesh(path)
    assert mesh.colored
    np.testing.assert_array_equal(mesh.texture.image, IMAGE)
    np.testing.assert_allclose(mesh.texture.uv, uv, atol=1e-6)
    column, row = (uv[:, 0] * 48).astype(int), ((1.0 - uv[:, 1]) * 32).astype(int)
    np.testing.assert_array_equal(mesh.colors, IMAGE[row, column])


@pytest.mark.parametrize("kind", ["ply", "obj"])
def test_a_missing_image_is_a_warning_and_grey(tmp_path, caplog, kind):
    path, _ = _write(tmp_path, kind)
    for image in tmp_path.glob("*.png"):
        image.unlink()
    with caplog.at_level(logging.WARNING):
        mesh = load_mesh(path)
    assert f"{path}: its texture" in caplog.text and "is missing" in caplog.text
    assert len(caplog.records) == 1
    assert mesh.texture is None and not mesh.colored
    assert (mesh.colors == PLAIN_COLOR).all()


def test_a_damaged_image_is_grey_too(tmp_path):
    path, _ = _write(tmp_path, "ply")
    (tmp_path / "box.png").write_bytes(b"no image")
    mesh = load_mesh(path)
    assert mesh.texture is None and not mesh.colored


@pytest.mark.parametrize("kind", ["stl", "ply"])
def test_files_without_colours_are_known_as_such(tmp_path, kind):
    path = tmp_path / f"box.{kind}"
    trimesh.creation.box((50, 60, 70)).export(path)
    mesh = load_mesh(path)
    assert not mesh.colored
    assert not decimate(mesh, 8).colored


def test_one_grey_is_no_colour_but_one_red_is(tmp_path):
    box = trimesh.creation.box((50, 60, 70))
    for color, colored in (([128, 128, 128, 255], False), ([200, 30, 30, 255], True)):
        box.visual = trimesh.visual.ColorVisuals(box, vertex_colors=[color] * 8)
        box.export(tmp_path / "box.ply")
        assert load_mesh(tmp_path / "box.ply").colored is colored
