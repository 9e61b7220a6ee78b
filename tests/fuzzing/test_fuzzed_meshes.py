"""Whatever stands in a mesh file: a sound mesh, or an error that names the file."""

import numpy as np
import pytest
import trimesh
from hypothesis import given
from hypothesis import strategies as st
from spoiled_files import is_clean, spoiled

from hlp.errors import DataError
from hlp.objects.meshes import load_mesh

BOX = trimesh.creation.box((0.06, 0.08, 0.1))
COLORED = trimesh.Trimesh(
    BOX.vertices, BOX.faces, vertex_colors=np.arange(32).reshape(8, 4) * 7, process=False
)
OBJ = "mtllib box.mtl\nusemtl red\n" + trimesh.exchange.obj.export_obj(BOX, header="")
MTL = b"newmtl red\nKd 0.8 0.1 0.1\nmap_Kd box.png\n"
OFF = trimesh.exchange.off.export_off(BOX)
FILES = {
    "ascii.ply": COLORED.export(file_type="ply", encoding="ascii"),
    "binary.ply": COLORED.export(file_type="ply"),
    "box.obj": OBJ.encode(),
    "binary.stl": BOX.export(file_type="stl"),
    "ascii.stl": BOX.export(file_type="stl_ascii").encode(),
    "box.off": OFF.encode() if isinstance(OFF, str) else OFF,
    "box.glb": BOX.export(file_type="glb"),
}


def read(path):
    mesh = load_mesh(path, None)
    count = len(mesh.vertices)
    assert mesh.normals.shape == (count, 3) and mesh.colors.shape == (count, 3)
    assert np.isfinite(mesh.vertices).all() and np.isfinite(mesh.normals).all()
    assert len(mesh.faces) and mesh.faces.min() >= 0 and mesh.faces.max() < count


@pytest.mark.parametrize("name", FILES)
@given(data=st.data())
def test_meshes(tmp_path, name, data):
    path = tmp_path / name
    path.write_bytes(FILES[name])
    assert is_clean(lambda: read(path), path)
    path.write_bytes(data.draw(spoiled(FILES[name])))
    is_clean(lambda: read(path), path)


@given(spoiled(MTL))
def test_materials(tmp_path, content):
    path = tmp_path / "box.obj"
    path.write_bytes(FILES["box.obj"])
    (tmp_path / "box.mtl").write_bytes(content)
    is_clean(lambda: read(path), path)


def test_vertices_without_three_coordinates(tmp_path):
    (tmp_path / "box.obj").write_text("v 1\nv 0 0 1\nv 0 1 0\nf 1 2 3\n")
    with pytest.raises(DataError, match="without three coordinates"):
        load_mesh(tmp_path / "box.obj", None)


@pytest.mark.parametrize("name", ["1" + "0" * 400, "a\0b"])
def test_a_material_s_name_that_no_file_can_have(tmp_path, name):
    path = tmp_path / "box.obj"
    path.write_text(OBJ.replace("box.mtl", name))
    assert is_clean(lambda: read(path), path)
