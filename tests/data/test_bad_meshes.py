"""Meshes that are none."""

import struct
from pathlib import Path
from typing import Any

import pytest
import trimesh

from bad_input import Case, check, of_file
from hlp.objects.meshes import load_mesh

BOX = trimesh.creation.box((70, 80, 90))


def mesh(name: str, content: str | bytes) -> Any:
    return of_file(load_mesh, name, content)


def ply(vertices: str, faces: str, count: int = 3, head: str = "ply\nformat ascii 1.0\n") -> str:
    return (
        f"{head}element vertex {count}\nproperty float x\nproperty float y\nproperty float z\n"
        f"element face 1\nproperty list uchar int vertex_indices\nend_header\n{vertices}\n{faces}\n"
    )


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
    "mesh of another kind": (mesh("a.xyz", "1 2 3\n4 5 6\n"), "a.xyz"),
    "mesh without extension": (mesh("a", BINARY_PLY), "cannot be read as a mesh"),
}

CASES = {**MESHES}


@pytest.mark.parametrize("case", CASES)
def test_what_is_wrong_is_said_by_an_error_of_our_own(tmp_path: Path, case: str) -> None:
    check(CASES[case], tmp_path)


def test_no_case_is_lost() -> None:
    assert len(CASES) >= 28
