"""Meshes that are none."""

import struct
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import trimesh

from bad_input import Case, check, of_file, written
from hlp.objects.meshes import load_mesh

BOX = trimesh.creation.box((70, 80, 90))


def mesh(name: str, content: str | bytes) -> Any:
    return of_file(load_mesh, name, content)


def ply(vertices: str, faces: str, count: int = 3, head: str = "ply\nformat ascii 1.0\n") -> str:
    return (
        f"{head}element vertex {count}\nproperty float x\nproperty float y\nproperty float z\n"
        f"element face 1\nproperty list uchar int vertex_indices\nend_header\n{vertices}\n{faces}\n"
    )


def textured_mesh(uv: str) -> Any:
    """A tetrahedron with a texture, one of whose corners has these texture coordinates."""

    def read(folder: Path) -> object:
        pixels = np.arange(48, dtype=np.uint8).reshape(4, 4, 3)
        written(folder / "a.png", cv2.imencode(".png", pixels)[1].tobytes())
        written(folder / "a.mtl", "newmtl a\nmap_Kd a.png\n")
        corners = "v 0 0 0\nv 90 0 0\nv 0 90 0\nv 0 0 70\nvt 0 0\nvt 1 0\nvt 0 1\n"
        faces = "f 1/1 2/2 3/3\nf 1/1 2/2 4/4\nf 1/1 3/3 4/4\nf 2/2 3/3 4/4\n"
        text = f"mtllib a.mtl\n{corners}vt {uv}\nusemtl a\n{faces}"
        return load_mesh(written(folder / "a.obj", text))

    return read


BINARY_PLY = bytes(BOX.export(file_type="ply"))
BINARY_STL = bytes(BOX.export(file_type="stl"))
CORNERS = "0 0 0\n90 0 0\n0 90 0"
TINY = trimesh.creation.box((0.07, 0.08, 0.09))
HUGE = trimesh.creation.box((70000, 80000, 90000))
MESHES: dict[str, Case] = {
    "no mesh": (lambda folder: load_mesh(folder / "a.ply"), "no mesh"),
    "mesh: a folder": (load_mesh, "no mesh"),
    "ply: empty": (mesh("a.ply", ""), "cannot be read as a mesh"),
    "ply: text": (mesh("a.ply", "this is no mesh"), "cannot be read as a mesh"),
    "ply: header alone": (mesh("a.ply", BINARY_PLY[:60]), "cannot be read as a mesh"),
    "ply: half": (mesh("a.ply", BINARY_PLY[: len(BINARY_PLY) // 2]), "cannot be read as a mesh"),
    "ply: zeros": (mesh("a.ply", b"\0" * 400), "cannot be read as a mesh"),
    "ply: a face of vertex 9": (mesh("a.ply", ply(CORNERS, "3 0 1 9")), "vertex"),
    "ply: a face of vertex -1": (mesh("a.ply", ply(CORNERS, "3 0 1 -1")), "vertex"),
    "ply: NaN": (mesh("a.ply", ply("nan 0 0\n90 0 0\n0 90 0", "3 0 1 2")), "NaN or infinite"),
    "ply: infinity": (mesh("a.ply", ply("inf 0 0\n90 0 0\n0 90 0", "3 0 1 2")), "NaN or inf"),
    "ply: words": (mesh("a.ply", ply("a b c\n90 0 0\n0 90 0", "3 0 1 2")), "cannot be read"),
    "ply: metres": (mesh("a.ply", TINY.export(file_type="ply")), "probably the wrong unit"),
    "ply: micrometres": (mesh("a.ply", HUGE.export(file_type="ply")), "probably the wrong unit"),
    "obj: empty": (mesh("a.obj", ""), "no triangles"),
    "obj: no faces": (mesh("a.obj", "v 0 0 0\nv 90 0 0\nv 0 90 0\n"), "no triangles"),
    "obj: words": (mesh("a.obj", "v a b c\nf 1 2 3\n"), "cannot be read"),
    "obj: a face of vertex 9": (mesh("a.obj", "v 0 0 0\nv 90 0 0\nv 0 90 0\nf 1 2 9\n"), "a.obj"),
    "obj: NaN": (mesh("a.obj", "v nan 0 0\nv 90 0 0\nv 0 90 0\nf 1 2 3\n"), "NaN or infinite"),
    "stl: empty": (mesh("a.stl", b""), "a.stl"),
    "stl: half": (mesh("a.stl", BINARY_STL[: len(BINARY_STL) // 2]), "a.stl"),
    "stl: text": (mesh("a.stl", "solid nothing\nendsolid nothing\n"), "a.stl"),
    "stl: many stated": (mesh("a.stl", b"\0" * 80 + struct.pack("<I", 2**31)), "a.stl"),
    "glb: text": (mesh("a.glb", "glTF"), "cannot be read as a mesh"),
    "gltf: no JSON": (mesh("a.gltf", "{"), "cannot be read as a mesh"),
    "gltf: a list": (mesh("a.gltf", "[]"), "cannot be read as a mesh"),
    "obj: texture coordinates": (textured_mesh("1e30 -1e30"), "has texture coordinates beyond"),
    "ply: points for triangles": (mesh("a.ply", ply(CORNERS, "3 1 1 1")), "has no surface"),
    "ply: lines for triangles": (mesh("a.ply", ply(CORNERS, "3 0 0 1")), "has no surface"),
    "ply: vertices on a line": (
        mesh("a.ply", ply("0 0 0\n9 0 0\n90 0 0", "3 0 1 2")),
        "no surface",
    ),
    "dae without its package": (mesh("a.dae", "<COLLADA/>"), "a.dae cannot be read as a mesh"),
    "3mf without its package": (mesh("a.3mf", b"PK\3\4"), "a.3mf cannot be read as a mesh"),
    "mesh of another kind": (mesh("a.xyz", "1 2 3\n4 5 6\n"), "a.xyz"),
    "mesh without extension": (mesh("a", BINARY_PLY), "cannot be read as a mesh"),
}

CASES = {**MESHES}


@pytest.mark.parametrize("case", CASES)
def test_what_is_wrong_is_said_by_an_error_of_our_own(tmp_path: Path, case: str) -> None:
    check(CASES[case], tmp_path)


def test_no_case_is_lost() -> None:
    assert len(CASES) >= 34
