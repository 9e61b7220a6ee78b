"""Whatever is wrong with a file or a value: HLP's own error, which names what is expected."""

import json
import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import trimesh

from hlp.data.bop_models import load_object_models
from hlp.data.bop_scenes import list_scenes
from hlp.data.bop_targets import list_targets
from hlp.data.camera_files import read_camera
from hlp.data.depth_files import depth_in_metres, guess_unit, read_raw_depth
from hlp.data.image_headers import depth_image_size, image_size
from hlp.data.images import read_depth, read_rgb
from hlp.data.linemod import read_dpt, read_matrix
from hlp.data.rgbd_frames import RgbdFrames
from hlp.errors import HlpError
from hlp.files import read_npz
from hlp.method.learnt_folder import read_record
from hlp.objects.meshes import load_mesh
from hlp.objects.object_model import ObjectSettings
from hlp.refinement.score_model import load_score_model
from hlp.reporting.results import read_results
from hlp.results.poses_file import read_poses
from hlp.results.scores_file import read_scores
from hlp.results.summary_file import read_summary
from hlp.schemas.reading import read_text_json
from hlp.stages.manifest import read_manifest

Case = tuple[Callable[[Path], object], str]
BOX = trimesh.creation.box((70, 80, 90))
DEEP = "[" * 100_000


def written(path: Path, content: str | bytes) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(content.encode() if isinstance(content, str) else content)
    return path


def of_file(read: Callable[[Path], object], name: str, content: str | bytes) -> Any:
    """A reader of one file with some content."""
    return lambda folder: read(written(folder / name, content))


def pixels(read: Callable[[Path], object], name: str, image: np.ndarray) -> Any:
    """A reader of an image."""
    return of_file(read, name, cv2.imencode(Path(name).suffix, image)[1].tobytes())


BROKEN_JSON = {
    "": "is no JSON",
    "{": "is no JSON",
    "[1, 2": "is no JSON",
    "{'a': 1}": "is no JSON",
    '{"a": 1,}': "is no JSON",
    "nul": "is no JSON",
    '{"1": 1, "1": 2}': "states the key '1' twice",
    DEEP: "nested deeper than 64",
    '{"a":' * 100_000: "nested deeper than 64",
    "[" * 80 + "]" * 80: "nested deeper than 64",
}
JSON: dict[str, Case] = {
    f"json {text[:20]!r} {len(text)}": (of_file(read_text_json, "a.json", text), said)
    for text, said in BROKEN_JSON.items()
} | {
    "json in UTF-16": (of_file(read_text_json, "a.json", '{"a": 1}'.encode("utf-16")), "UTF-8"),
    "json of zeros": (of_file(read_text_json, "a.json", b"\0" * 64), "is no JSON"),
    "json that is a folder": (read_text_json, "there is no file"),
    "no json": (lambda folder: read_text_json(folder / "none.json"), "there is no file"),
    "large json": (
        lambda folder: read_text_json(written(folder / "a.json", "[" + "1," * 99 + "1]"), 100),
        "has 201 bytes: at most 100",
    ),
}


def targets(text: str) -> Any:
    return of_file(lambda path: list_targets({}, path), "targets.json", text)


ROW = {"scene_id": 1, "im_id": 2, "obj_id": 3, "inst_count": 1}
TARGETS: dict[str, Case] = {
    "targets: an object": (targets('{"6": [1, 2]}'), "it must be a list"),
    "targets: null": (targets("null"), "the content is null: it must be a list"),
    "targets: a number": (targets("7"), "the content is 7"),
    "targets: lists": (targets("[[1, 2]]"), "0 is [1, 2]: it must be an object"),
    "targets: null row": (targets("[null]"), "0 is null: it must be an object"),
    "targets: deep": (targets(DEEP), "nested deeper"),
    "targets: one object twice": (targets(json.dumps([ROW, ROW])), "lists object 3"),
    "targets: no scene": (targets('[{"im_id": 1}]'), "0.scene_id is missing"),
    "targets: no image": (targets('[{"scene_id": 1}]'), "0.im_id is missing"),
}
for _key in ROW:
    for _value, _said in (("1", "'1'"), (1.5, "1.5"), (-1, "-1"), (True, "True"), ([1], "[1]")):
        _name = f"targets: {_key} {_value!r}"
        TARGETS[_name] = (targets(json.dumps([{**ROW, _key: _value}])), f"0.{_key} is {_said}")
TARGETS["targets: no instance"] = (
    targets(json.dumps([{**ROW, "inst_count": 0}])),
    "inst_count is 0: it must be greater than or equal to 1",
)


def models(info: Any, steps: int = 8) -> Any:
    """A data set of one box with this entry in models_info.json, or this text of it."""

    def read(folder: Path) -> object:
        text = info if isinstance(info, str) else json.dumps({"1": info})
        written(folder / "models" / "models_info.json", text)
        written(folder / "models" / "obj_000001.ply", BOX.export(file_type="ply"))
        return load_object_models(folder, {"box": ObjectSettings(1)}, 500, steps)

    return read


def turned(axis: list[float], offset: list[float]) -> Any:
    return {"diameter": 139.3, "symmetries_continuous": [{"axis": axis, "offset": offset}]}


HALF_TURN = np.diag([-1.0, -1.0, 1.0, 1.0]).ravel().tolist()
QUARTER = [0.0, -1.0, 0.0, 0.0, 0.0, 0.0, -1.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]
MODELS: dict[str, Case] = {
    "models_info: a list": (models("[1]"), "the content is [1]: it must be an object"),
    "models_info: deep": (models(DEEP), "nested deeper"),
    "models_info: no JSON": (models("?"), "is no JSON"),
    "models_info: null": (models(None), "1 is null: it must be an object"),
    "models_info: metres": (models({"diameter": 0.1393}), "must be in millimetres"),
    "models_info: tenth": (models({"diameter": 13.93}), "the mesh's is 139.2"),
    "models_info: another mesh": (models({"diameter": 300.0}), "diameter is 300"),
    "models_info: no size": (models({"diameter": 0}), "1.diameter is 0"),
    "models_info: below 0": (models({"diameter": -1.0}), "1.diameter is -1.0"),
    "models_info: NaN": (models('{"1": {"diameter": NaN}}'), "1.diameter is nan"),
    "models_info: infinity": (models('{"1": {"diameter": Infinity}}'), "1.diameter is inf"),
    "models_info: text": (models({"diameter": "139"}), "1.diameter is '139': it must be a number"),
    "models_info: true": (models({"diameter": True}), "1.diameter is True"),
    "symmetries: null": (models({"symmetries_discrete": None}), "is null: it must be a list"),
    "symmetries: an object": (models({"symmetries_discrete": {}}), "it must be a list"),
    "symmetries: 15 numbers": (
        models({"symmetries_discrete": [HALF_TURN[:15]]}),
        "symmetries_discrete.0 has 15 numbers, it must have 16",
    ),
    "symmetries: text": (models({"symmetries_discrete": [["a"] * 16]}), "is 'a': it must be a num"),
    "symmetries: a reflection": (
        models({"symmetries_discrete": [np.diag([-1.0, 1, 1, 1]).ravel().tolist()]}),
        "symmetries_discrete.0 is no rotation but a reflection",
    ),
    "symmetries: scaled": (
        models({"symmetries_discrete": [np.diag([2.0, 2, 2, 1]).ravel().tolist()]}),
        "symmetries_discrete.0 is no rotation",
    ),
    "symmetries: columns": (
        models({"symmetries_discrete": [[*HALF_TURN[:12], 5.0, 0.0, 0.0, 1.0]]}),
        "its last row is [5.0, 0.0, 0.0, 1.0]",
    ),
    "symmetries: far away": (
        models({"symmetries_discrete": [[*HALF_TURN[:3], 90.0, *HALF_TURN[4:]]]}),
        "a turn by 180°",
    ),
    "symmetries: in metres": (models(turned([0, 0, 1], [0.5, 90.0, 0])), "stated symmetry"),
    "symmetries: no turn of a box": (models(turned([1, 1, 0], [0, 0, 0])), "from itself"),
    "symmetries: no axis": (
        models({"symmetries_continuous": [{"offset": [0, 0, 0]}]}),
        "1.symmetries_continuous.0.axis is missing",
    ),
    "symmetries: no offset": (
        models({"symmetries_continuous": [{"axis": [0, 0, 1]}]}),
        "offset is missing",
    ),
    "symmetries: null axis": (
        models({"symmetries_continuous": [{"axis": None, "offset": [0, 0, 0]}]}),
        "axis is null: it must be a list",
    ),
    "symmetries: axis of length 0": (models(turned([0, 0, 0], [0, 0, 0])), "positive length"),
    "symmetries: short axis": (models(turned([0, 1], [0, 0, 0])), "axis has 2 numbers, it must"),
    "symmetries: too many": (
        models({"symmetries_continuous": [{"axis": [0, 0, 1], "offset": [0, 0, 0]}] * 40}, 315),
        "12600 motions",
    ),
}


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


def rot(path: Path) -> object:
    return read_matrix(path, 9)


NINE = "3 3\n1 0 0\n0 1 0\n0 0 1\n"
LINEMOD: dict[str, Case] = {
    "no dpt": (lambda folder: read_dpt(folder / "a.dpt"), "no depth"),
    "no rot": (lambda folder: rot(folder / "a.rot"), "no pose"),
    "dpt: empty": (of_file(read_dpt, "a.dpt", b""), "truncated or no .dpt"),
    "dpt: short header": (of_file(read_dpt, "a.dpt", b"\1\0\0\0"), "truncated or no .dpt"),
    "dpt: below 0": (of_file(read_dpt, "a.dpt", struct.pack("<ii", -2, -2)), "truncated or no"),
    "dpt: 0 rows": (of_file(read_dpt, "a.dpt", struct.pack("<ii", 0, 4)), "truncated or no .dpt"),
    "dpt: too short": (of_file(read_dpt, "a.dpt", struct.pack("<ii", 2, 2) + b"\1" * 7), "trunc"),
    "dpt: too long": (of_file(read_dpt, "a.dpt", struct.pack("<ii", 2, 2) + b"\1" * 9), "trunc"),
    "dpt: huge": (of_file(read_dpt, "a.dpt", struct.pack("<ii", 2**30, 2**30)), "truncated or no"),
    "rot: empty": (of_file(rot, "a.rot", ""), "9 finite numbers"),
    "rot: header alone": (of_file(rot, "a.rot", "3 3\n"), "9 finite numbers"),
    "rot: eight": (of_file(rot, "a.rot", NINE.replace("0 0 1", "0 1")), "9 finite numbers"),
    "rot: ten": (of_file(rot, "a.rot", NINE + "1"), "9 finite numbers"),
    "rot: NaN": (of_file(rot, "a.rot", NINE.replace("1 0 0", "nan 0 0")), "9 finite numbers"),
    "rot: words": (of_file(rot, "a.rot", NINE.replace("1 0 0", "x 0 0")), "no number"),
    "rot: bytes": (of_file(rot, "a.rot", b"\xff\xfe\n\xff\xff"), "a.rot"),
}


def encoder_frames(**camera: Any) -> Any:
    """A folder of RGB-D frames with this camera.json."""

    def read(folder: Path) -> object:
        for kind, image in (("rgb", np.zeros((8, 8, 3))), ("depth", np.full((8, 8), 900))):
            depth = image.astype(np.uint16 if kind == "depth" else np.uint8)
            written(folder / kind / "1.png", cv2.imencode(".png", depth)[1].tobytes())
        written(folder / "camera.json", json.dumps(camera))
        frames = RgbdFrames(folder)
        return frames.load(frames.keys[0])

    return read


def raw(path: Path) -> object:
    return depth_in_metres(read_raw_depth(path), 1.0, path)


def guessed(path: Path) -> object:
    return guess_unit(read_raw_depth(path), path)


def size(path: Path) -> object:
    return image_size(path, 0.001)


def depth_size(path: Path) -> object:
    return depth_image_size(path, 50.0)


def millimetres(path: Path) -> object:
    return read_depth(path, 1.0)


PNG = cv2.imencode(".png", np.random.default_rng(0).integers(0, 255, (40, 40, 3)))[1].tobytes()
JPG = cv2.imencode(".jpg", np.random.default_rng(0).integers(0, 255, (40, 40, 3)))[1].tobytes()
GREY, DEPTH = np.full((8, 8), 9, np.uint8), np.full((8, 8), 900, np.uint16)
IMAGES: dict[str, Case] = {
    "no image": (lambda folder: read_rgb(folder / "a.png"), "no image"),
    "no depth image": (lambda folder: read_raw_depth(folder / "a.png"), "no depth image"),
    "png: empty": (of_file(read_rgb, "a.png", b""), "truncated or no image"),
    "png: text": (of_file(read_rgb, "a.png", "png"), "truncated or no image"),
    "png: half": (of_file(read_rgb, "a.png", PNG[: len(PNG) // 2]), "truncated or no image"),
    "jpg: header": (of_file(read_rgb, "a.jpg", JPG[:20]), "truncated or no image"),
    "header of text": (of_file(size, "a.png", "png"), "truncated or no image"),
    "header of nothing": (of_file(size, "a.png", b""), "truncated or no image"),
    "header cut": (of_file(size, "a.png", PNG[:20]), "truncated or no image"),
    "no header": (lambda folder: size(folder / "a.png"), "no image"),
    "too large": (of_file(size, "a.png", PNG), "raise data.max_megapixels"),
    "depth header of 8 bits": (pixels(depth_size, "a.png", GREY), "16-bit PNG of one channel"),
    "depth header of colours": (of_file(depth_size, "a.png", PNG), "16-bit PNG of one channel"),
    "depth of 8 bits": (pixels(millimetres, "a.png", GREY), "16-bit PNG of one channel"),
    "depth in colours": (of_file(millimetres, "a.png", PNG), "16-bit PNG of one channel"),
    "depth of zeros": (pixels(millimetres, "a.png", DEPTH * 0), "no depth at any pixel"),
    "depth saturated": (pixels(millimetres, "a.png", DEPTH * 0 + 65535), "no depth at any pixel"),
    "own depth of 8 bits": (pixels(raw, "a.png", GREY), "16-bit numbers"),
    "own depth of zeros": (pixels(raw, "a.png", DEPTH * 0), "no depth at any pixel"),
    "own depth nearby": (pixels(raw, "a.png", DEPTH * 0 + 3), "check depth_scale"),
    "own depth far away": (pixels(raw, "a.png", DEPTH * 60), "check depth_scale"),
    "own depth in no unit": (pixels(guessed, "a.png", DEPTH * 60), "give depth_scale"),
    "own depth cut": (of_file(raw, "a.npy", b"\x93NUMPY"), "truncated or no array"),
    "own depth text": (of_file(raw, "a.npy", "1 2 3"), "truncated or no array"),
    "own depth tiff": (of_file(raw, "a.tiff", "II*"), "truncated or no image"),
    "arrays cut": (of_file(read_npz, "a.npz", b"PK\3\4"), "damaged"),
    "arrays of text": (of_file(read_npz, "a.npz", "text"), "damaged"),
    "no arrays": (lambda folder: read_npz(folder / "a.npz"), "there is no file"),
    "camera.json: no cam_K": (encoder_frames(depth_scale=1.0), "camera.json: cam_K is missing"),
    "camera.json: words": (encoder_frames(cam_K=["a"] * 9), "cam_K.0 is 'a': it must be a number"),
    "camera.json: no focal length": (encoder_frames(cam_K=[0] * 9), "positive focal lengths"),
    "rooms: no folders": (lambda folder: RgbdFrames(folder).keys, "has no folders rgb and depth"),
}


def intrinsics(content: Any, name: str = "k.json") -> Any:
    text = content if isinstance(content, str | bytes) else json.dumps(content)
    return of_file(lambda path: read_camera(str(path)), name, text)


K = [500.0, 0.0, 320.0, 0.0, 500.0, 240.0, 0.0, 0.0, 1.0]
INTRINSICS: dict[str, Case] = {
    "no intrinsics": (lambda folder: read_camera(str(folder / "k.json")), "is no file"),
    "numbers: three": (lambda _: read_camera([1, 2, 3]), "nine numbers"),
    "numbers: none": (lambda _: read_camera([]), "nine numbers"),
    "numbers: no focal length": (lambda _: read_camera([0, 500, 320, 240]), "positive focal"),
    "numbers: NaN": (lambda _: read_camera([float("nan"), 500, 320, 240]), "finite numbers"),
    "K: empty file": (intrinsics(""), "k.json"),
    "K: null": (intrinsics("null"), "neither keys nor nine"),
    "K: text": (intrinsics('"K"'), "neither keys nor nine"),
    "K: no JSON": (intrinsics("{"), "k.json is no JSON"),
    "K: bytes": (intrinsics(b"\xff\xfe\xfa"), "is no text"),
    "K: deep": (intrinsics(DEEP), "nested deeper"),
    "K: deep YAML": (intrinsics("K: " + "[" * 5000, "k.yaml"), "k.yaml"),
    "K: an alias": (intrinsics("a: &a [1, 1]\nK: [*a, *a]\n", "k.yaml"), "refers to itself"),
    "K: no keys": (intrinsics({}), "no cam_K"),
    "K: other keys": (intrinsics({"focal": 500}), "no cam_K"),
    "K: eight": (intrinsics({"cam_K": K[:8]}), "nine numbers"),
    "K: null numbers": (intrinsics({"cam_K": None}), "nine numbers"),
    "K: words": (intrinsics({"cam_K": ["f"] * 9}), "9 numbers"),
    "K: an object": (intrinsics({"cam_K": {"fx": 1}}), "nine numbers"),
    "K: ragged": (intrinsics({"cam_K": [[1, 2, 3], [4, 5], [6]]}), "nine numbers"),
    "K: columns": (
        intrinsics({"cam_K": np.reshape(K, (3, 3)).T.ravel().tolist()}),
        "is no camera matrix",
    ),
    "K: skewed last row": (intrinsics({"cam_K": [*K[:8], 2.0]}), "is no camera matrix"),
    "K: negative": (intrinsics({"cam_K": [-500.0, *K[1:]]}), "positive focal"),
    "K: null focal length": (intrinsics({"fx": None, "fy": 1, "cx": 1, "cy": 1}), "K.json"[1:]),
    "K: depth_scale 0": (intrinsics({"cam_K": K, "depth_scale": 0}), "must be a positive number"),
    "K: depth_scale text": (intrinsics({"cam_K": K, "depth_scale": "1"}), "a positive number"),
    "K: width 0": (intrinsics({"cam_K": K, "width": 0, "height": 480}), "give pixels"),
    "K: width text": (intrinsics({"cam_K": K, "width": "a", "height": 480}), "give pixels"),
    "K: no height": (intrinsics({"cam_K": K, "width": 640}), "give pixels"),
    "K: distortion in words": (intrinsics({"cam_K": K, "D": ["a"]}), "must be numbers"),
    "K: three coefficients": (intrinsics({"cam_K": K, "D": [1, 1, 1]}), "3 distortion coeff"),
    "K: unknown model": (
        intrinsics({"cam_K": K, "D": [0.1] * 4, "distortion_model": "magic"}),
        "cannot be undone",
    ),
    "K: several cameras": (
        intrinsics({"0": {"cam_K": K}, "1": {"cam_K": [501.0, *K[1:]]}}),
        "several cameras",
    ),
    "K: null frame": (intrinsics({"0": None}), "no cam_K"),
    "K: Open3D of 8": (intrinsics({"intrinsic_matrix": K[:8]}), "nine numbers"),
    "K: words in text": (intrinsics("fx fy cx cy", "k.txt"), "k.txt"),
    "K: five numbers": (intrinsics("1 2 3 4 5", "k.txt"), "nine numbers"),
}


def run_folder(files: dict[str, str]) -> Any:
    def read(folder: Path) -> object:
        for name, text in files.items():
            written(folder / name, text)
        return read_results(folder)

    return read


HEADER = "scene_id,im_id,obj_id,score,R,t,time\n"
FINE = "1,2,3,0.5,1 0 0 0 1 0 0 0 1,0 0 700,-1\n"
RECORDS: dict[str, Case] = {
    "manifest: none": (lambda folder: read_manifest(folder / "manifest.json"), "there is no file"),
    "manifest: a list": (of_file(read_manifest, "manifest.json", "[]"), "no manifest of a run"),
    "manifest: null": (of_file(read_manifest, "manifest.json", "null"), "no manifest of a run"),
    "manifest: config null": (
        of_file(read_manifest, "manifest.json", '{"config": null}'),
        "no manifest of a run",
    ),
    "manifest: deep": (of_file(read_manifest, "manifest.json", DEEP), "manifest.json"),
    "summary: a list": (of_file(read_summary, "summary.json", "[]"), "no summary of a run"),
    "summary: empty": (of_file(read_summary, "summary.json", "{}"), "it lacks metrics"),
    "results: no manifest": (run_folder({"summary.json": "{}"}), "manifest.json"),
    "results: a list": (run_folder({"manifest.json": "[]", "summary.json": "{}"}), ""),
    "sweep: a list": (run_folder({"sweep.json": "[]"}), "sweep.json"),
    "sweep: no keys": (run_folder({"sweep.json": "{}"}), ""),
    "sweep: null": (run_folder({"sweep.json": '{"overrides": null, "swept": []}'}), ""),
    "learnt: none": (read_record, "holds no learnt objects"),
    "learnt: a list": (
        lambda folder: read_record(written(folder / "learnt.json", "[]").parent),
        "format is []",
    ),
    "learnt: another format": (
        lambda folder: read_record(written(folder / "learnt.json", '{"format": 99}').parent),
        "format is 99",
    ),
    "learnt: no JSON": (
        lambda folder: read_record(written(folder / "learnt.json", "{").parent),
        "learn",
    ),
    "score: none": (load_score_model, "is missing"),
    "poses: none": (lambda folder: read_poses(folder / "poses.csv"), "there is no file"),
    "poses: empty": (of_file(read_poses, "poses.csv", ""), "the first line must be"),
    "poses: another header": (of_file(read_poses, "poses.csv", "a,b\n"), "the first line must be"),
    "scores: empty": (of_file(read_scores, "scores.csv", ""), "the first line must be"),
}
for _column, _value in (
    ("scene_id", "x"), ("im_id", "1.5"), ("obj_id", ""), ("score", "high"), ("score", ""),
    ("R", "1 0 0"), ("R", "a b c"), ("R", ""), ("t", "0 0"), ("t", "x y z"), ("time", "soon"),
):  # fmt: skip
    _row = dict(zip(HEADER.strip().split(","), FINE.strip().split(","), strict=True))
    _text = HEADER + ",".join({**_row, _column: _value}.values()) + "\n"
    RECORDS[f"poses: {_column} {_value!r}"] = (of_file(read_poses, "poses.csv", _text), "poses.csv")
RECORDS["poses: short row"] = (of_file(read_poses, "poses.csv", HEADER + "1,2,3\n"), "poses.csv")

SCENES: dict[str, Case] = {
    "no split": (lambda folder: list_scenes(folder / "test"), "no folder"),
    "no scene": (list_scenes, "no scene in"),
}
for _text, _said in (
    ("[]", "must be an object"),
    ("null", "must be an object"),
    ('{"a": {}}', "the key 'a' is no id"),
    ('{"-1": {}}', "the key '-1' is no id"),
    ('{"01": {}}', "the key '01' is no id"),
    ('{"1.5": {}}', "the key '1.5' is no id"),
    (DEEP, "nested deeper"),
):

    def _frames(folder: Path, text: str = _text) -> object:
        written(folder / "000001" / "scene_camera.json", text)
        return list_scenes(folder)[1].frame_ids

    SCENES[f"scene_camera: {_text[:9]}"] = (_frames, _said)

CASES = {
    **JSON, **TARGETS, **MODELS, **MESHES, **LINEMOD, **IMAGES, **INTRINSICS, **RECORDS, **SCENES,
}  # fmt: skip


@pytest.mark.parametrize("case", CASES)
def test_what_is_wrong_is_said_by_an_error_of_our_own(tmp_path: Path, case: str) -> None:
    read, words = CASES[case]
    with pytest.raises(HlpError) as caught:
        read(tmp_path)
    assert words in str(caught.value)
    assert len(str(caught.value)) < 600


def test_there_are_many_cases() -> None:
    assert len(CASES) >= 200
