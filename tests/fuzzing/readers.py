"""Everything that reads a file from outside, with a valid file: what the fuzzer spoils."""

import io
import json
import tarfile
import zipfile
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from random import Random
from typing import Any

import cv2
import numpy as np
import trimesh
from spoiled_files import is_clean, spoiled

from hlp import schemas
from hlp.commands.arguments import search_masks
from hlp.data.bop_models import name_objects, symmetry_motions
from hlp.data.bop_scenes import list_scenes, list_targets, most_visible
from hlp.data.camera_files import read_camera
from hlp.data.cameras import BrokenImage, LinesCamera
from hlp.data.download import unpack
from hlp.data.file_frames import read_numbers
from hlp.data.images import depth_metres, image_size, read_raw_depth, read_rgb
from hlp.data.own_frames import CameraSettings
from hlp.data.ycbineoat import read_pose
from hlp.files import read_npz
from hlp.fingerprints import sealed
from hlp.geometry import rigid
from hlp.method.learn.learnt_folder import LearntRecord, read_record, write_record
from hlp.method.learn.model_files import read_history
from hlp.method.settings import MethodSettings
from hlp.objects.meshes import load_mesh
from hlp.records import PoseEstimate, TargetScore
from hlp.reporting.page.report_data import ReportData, picture_path
from hlp.reporting.summary_tables import format_summary, run_cells, waterfall_tables
from hlp.reporting.sweeps import read_sweeps
from hlp.results.poses_file import read_poses, read_scores, write_poses, write_scores
from hlp.results.recalls import read_summary
from hlp.schemas import camera_matrix
from hlp.settings import read_as
from hlp.stages.manifest import read_manifest
from hlp.stages.store import StageStore
from written_results import summary


@dataclass(frozen=True)
class Case:
    """A file that is spoiled, valid ones beside it, what reads the folder, and what errors name."""

    name: str
    content: bytes
    read: Callable[[Path], object]
    beside: Mapping[str, bytes]
    named: str
    resealed: bool = False


def case(name: str, content: Any, read: Callable[[Path], object], **given: Any) -> Case:
    """A case; JSON is written from its values, and errors name the file."""
    beside = {other: _written(value) for other, value in given.pop("beside", {}).items()}
    given.setdefault("named", Path(name).name)
    return Case(name, _written(content), read, beside, **given)


def _written(content: Any) -> bytes:
    if isinstance(content, str | bytes):
        return content.encode() if isinstance(content, str) else content
    return json.dumps(content).encode()


def try_seed(cases: Sequence[Case], seed: int, folder: Path) -> None:
    """Spoil the file of one case at random, and read it."""
    rng, chosen = Random(seed), cases[seed % len(cases)]  # noqa: S311
    content = spoiled(chosen.content, rng)
    if chosen.resealed:  # the checksum fits, as only somebody who wants it so can have it
        with suppress(ValueError, TypeError):
            content = _written(sealed(json.loads(content)))
    try_content(chosen, content, folder)


def try_content(chosen: Case, content: bytes, folder: Path) -> bool:
    """Read some content in a file's place."""
    for name, written in {**chosen.beside, chosen.name: content}.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(written)
    return is_clean(lambda: chosen.read(folder), chosen.named)


K = [500.0, 0, 40, 0, 510.0, 30, 0, 0, 1]
POSE = {"obj_id": 1, "cam_R_m2c": np.eye(3).ravel().tolist(), "cam_t_m2c": [1.0, 0, 700]}
CAMERAS = {"0": {"cam_K": K, "depth_scale": 0.1}, "12": {"cam_K": K, "depth_scale": 0.1}}
SCENE = {
    "test/000006/scene_camera.json": CAMERAS,
    "test/000006/scene_gt.json": {"0": [POSE, {**POSE, "obj_id": 6}], "12": [POSE]},
    "test/000006/scene_gt_info.json": {"0": [{"visib_fract": 0.9}, {"visib_fract": 0.1}], "12": []},
}
TARGETS = [{"scene_id": 6, "im_id": 0, "obj_id": 1, "inst_count": 1}, {"scene_id": 6, "im_id": 12}]
MODELS = {
    "1": {
        "diameter": 102.1,
        "symmetries_discrete": [np.diag([-1.0, -1, 1, 1]).ravel().tolist()],
        "symmetries_continuous": [{"axis": [0, 0, 1], "offset": [0, 0, 0]}],
    },
    "6": {"diameter": 90},
}


def _read_scene(folder: Path) -> None:
    scenes = list_scenes(folder / "test")
    list_targets(scenes, None, 0.1)
    for frame in (0, 12):
        scene = scenes[6]
        camera_matrix(scene.camera(frame).cam_K, f"{folder}/scene_camera.json", (80, 60))
        most_visible(scene.targets(frame), {1: 1}, scene.where(frame))


def _read_models(folder: Path) -> None:
    path = folder / "models_info.json"
    for info in read_as(path, dict[str, schemas.ModelInfo]).values():
        assert np.isfinite(symmetry_motions(info, 8, str(path))).all()


def _of_scene(name: str) -> Case:
    left_out = "_info" if name.endswith("scene_gt.json") else name  # other instances than fractions
    beside = {other: value for other, value in SCENE.items() if left_out not in other}
    return case(name, SCENE[name], _read_scene, beside=beside)


OPENCV = """%YAML:1.0
---
camera_matrix: !!opencv-matrix
   rows: 3
   cols: 3
   dt: d
   data: [ 500., 0., 40., 0., 510., 30., 0., 0., 1. ]
distortion_coefficients: !!opencv-matrix
   rows: 1
   cols: 5
   dt: d
   data: [ 0.1, 0., 0., 0., 0. ]
image_width: 80
image_height: 60
"""
REALSENSE = {"fx": 5, "fy": 5, "ppx": 4, "ppy": 3, "coeffs": [0] * 5, "model": "none"}
INTRINSICS = {
    "bop.json": CAMERAS,
    "camera.json": {"cam_K": K, "depth_scale": 0.1},
    "ros.json": {
        **{"width": 80, "height": 60, "K": K, "D": [0.1, 0, 0, 0, 0]},
        "distortion_model": "plumb_bob",
    },
    "realsense.json": {"intrinsics": REALSENSE},
    "open3d.json": {
        "intrinsic_matrix": [500.0, 0, 0, 0, 510.0, 0, 40, 30, 1],
        "width": 80,
        "height": 60,
    },
    "ros.yaml": "width: 80\nheight: 60\nk: [500, 0, 40, 0, 510, 30, 0, 0, 1]\nd: []\n---\n",
    "opencv.yaml": OPENCV,
    "cam_K.txt": "500 0 40\n0 510 30\n0 0 1\n",
}


def _intrinsics(name: str) -> Case:
    def read(folder: Path) -> None:
        camera = read_camera(str(folder / name))
        assert np.isfinite(camera.matrix).all() and (np.diag(camera.matrix) > 0).all()
        assert np.isfinite(camera.distortion).all()

    return case(name, INTRINSICS[name], read)


RAMP = np.arange(48, dtype=np.uint16).reshape(6, 8) * 20
COLORS = np.repeat(RAMP[..., None] // 4, 3, 2).astype(np.uint8)


def encoded(ending: str, image: np.ndarray) -> bytes:
    return cv2.imencode(ending, image)[1].tobytes()


def _saved(save: Callable[..., Any], *arrays: Any, **named: Any) -> bytes:
    stream = io.BytesIO()
    save(stream, *arrays, **named)
    return stream.getvalue()


def _image(name: str, content: bytes) -> Case:
    def read(folder: Path) -> None:
        path = folder / name
        image = read_rgb(path)
        assert image.dtype == np.uint8 and image.ndim == 3 and image.shape[2] == 3
        image_size(path, 50.0)

    return case(name, content, read)


def _depth(name: str, content: bytes) -> Case:
    def read(folder: Path) -> None:
        metres = depth_metres(read_raw_depth(folder / name), 1.0, folder / name)
        assert metres.ndim == 2 and np.isfinite(metres).all() and metres.min() >= 0.0

    return case(name, content, read)


def _numbers(name: str, content: str, read: Callable[[Path], np.ndarray]) -> Case:
    return case(name, content, lambda folder: np.isfinite(read(folder / name)).all() or 1 / 0)


def _packed(name: str) -> bytes:
    stream = io.BytesIO()
    if name.endswith(".zip"):
        with zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED) as packed:
            packed.writestr("lm/models/a.ply", "ply\n" * 50)
            packed.writestr("lm/b.json", "{}")
    else:
        with tarfile.open(fileobj=stream, mode="w:gz" if name.endswith("gz") else "w") as tape:
            for member in ("lm/models/a.ply", "lm/b.json"):
                about = tarfile.TarInfo(member)
                about.size = 200
                tape.addfile(about, io.BytesIO(b"ply\n" * 50))
    return stream.getvalue()


def _archive(name: str) -> Case:
    def read(folder: Path) -> None:
        target = folder / "in" / "to"
        target.mkdir(parents=True, exist_ok=True)
        try:
            unpack(folder / name, target, "lm")
        finally:
            assert {path.name for path in folder.iterdir()} == {name, "in"}
            assert [path.name for path in (folder / "in").iterdir()] == ["to"]

    return case(name, _packed(name), read)


def _lines(folder: Path) -> None:
    text = (folder / "lines.txt").read_text("utf-8", "surrogateescape")
    settings = CameraSettings(intrinsics=[50.0, 50.0, 4.0, 3.0], depth_scale=20.0)
    for image in LinesCamera(text.replace("HERE", str(folder)).splitlines(), settings):
        json.dumps({"name": image.name})
        if not isinstance(image, BrokenImage):
            json.dumps({"captured": image.captured}, allow_nan=False)


LINE = {"rgb": "HERE/a.png", "depth": "HERE/d.png", "name": "a", "captured": 1.5}
SCENE_3D = {
    **{"key": [1, 0, 2, 0], "picture": "a.jpg", "middle": [0.0, 0.0, 700.0], "points": "AAAA"},
    **{"colors": "AAAA", "truth": [1.0] * 16, "estimate": None},
}
WIRES = {"diameter_mm": 3.0, "vertices": [[0, 0, 1]], "edges": [[0, 0]]}


def _pictures(folder: Path) -> None:
    kept = ReportData.read(folder)
    for scene in kept.scenes.values():
        picture_path(folder, scene)


NAME = "0123456789abcdef"
MANIFEST = {
    "config": {"name": "demo", "seed": 0},
    "data": {"keys": ["000000_000000"], "frames": "ab"},
    "stages": [{"stage": "views", "fingerprint": NAME}],
}
SWEEP = {"overrides": ["seed=0,1"], "swept": ["seed"], "defaults": {"seed": 0}, "status": "done"}
OVERRIDES = "- experiment=demo\n- seed=1\n- output=out\n"
RUN = {"summary.json": summary(), "manifest.json": MANIFEST}


def _tables(folder: Path) -> None:
    found = read_summary(folder / "summary.json")
    run_cells(found)
    format_summary(found)
    waterfall_tables(found)


def _made(write: Callable[[Path], object], name: str, folder: Path) -> bytes:
    write(folder)
    return (folder / name).read_bytes()


def results(folder: Path) -> dict[str, list[Case]]:
    """The files that HLP writes; valid ones are made in a folder."""
    pose = rigid(np.eye(3), np.array([0.1, 0.2, 0.9]))
    poses = [PoseEstimate(1, 2, 3, pose, 0.5, {"a": 1.0})] * 2
    scores = [
        TargetScore(1, number, 2, True, 0.9, 0.01, 0.1, 0.02, 0.8, True, True, True)
        for number in (0, 1)
    ]
    write_poses(folder / "poses.csv", poses)
    write_scores(folder / "scores.csv", scores, {2: "cat"})
    write_record(folder, LearntRecord({"cat": 1}, (1,), MethodSettings(), {"a": "0"}))
    StageStore(folder).get_or_make("views", NAME, lambda made: (made / "x").touch(), {"a": {}})
    content = {path.name: path.read_bytes() for path in folder.iterdir() if path.is_file()}
    learnt, stage = content["learnt.json"], f"views/{NAME}/stage.json"
    output = (folder / stage).read_bytes()
    beside = {f"views/{NAME}/x": b""}

    def of_stage(at: Path) -> None:
        StageStore(at).read_record("views", NAME)

    read = read_sweeps
    return {
        "poses.csv": [
            case("poses.csv", content["poses.csv"], lambda at: read_poses(at / "poses.csv"))
        ],
        "scores.csv": [
            case("scores.csv", content["scores.csv"], lambda at: read_scores(at / "scores.csv"))
        ],
        "learnt.json": [
            case("learnt.json", learnt, read_record),
            case("learnt.json", learnt, read_record, resealed=True),
            case(stage, output, of_stage, beside=beside, named=NAME),
            case(stage, output, of_stage, beside=beside, named=NAME, resealed=True),
        ],
        "runs": [
            case("history.csv", "epoch,loss\n0,1.5\n1,0.75\n", read_history),
            case("summary.json", summary(), _tables),
            case("manifest.json", MANIFEST, lambda at: read_manifest(at / "manifest.json")),
            case("manifest.json", MANIFEST, read, beside=RUN),
            case("sweep.json", SWEEP, read, beside={f"0/{name}": RUN[name] for name in RUN}),
            case(".hydra/overrides.yaml", OVERRIDES, read, beside=RUN),
        ],
    }


BOX = trimesh.creation.box((0.06, 0.08, 0.1))
COLORED = trimesh.Trimesh(
    BOX.vertices, BOX.faces, vertex_colors=np.arange(32).reshape(8, 4) * 7, process=False
)
OBJ = "mtllib box.mtl\nusemtl red\n" + trimesh.exchange.obj.export_obj(BOX, header="")
MTL = b"newmtl red\nKd 0.8 0.1 0.1\nmap_Kd box.png\n"
MESHES = {
    "ascii.ply": COLORED.export(file_type="ply", encoding="ascii"),
    "binary.ply": COLORED.export(file_type="ply"),
    "box.obj": OBJ,
    "binary.stl": BOX.export(file_type="stl"),
    "ascii.stl": BOX.export(file_type="stl_ascii"),
    "box.off": trimesh.exchange.off.export_off(BOX),
    "box.glb": BOX.export(file_type="glb"),
}


def _mesh(name: str, content: Any) -> Case:
    return case(name, content, lambda folder: read_mesh(folder / name))


def read_mesh(path: Path) -> None:
    mesh = load_mesh(path, None)
    count = len(mesh.vertices)
    assert mesh.normals.shape == (count, 3) and mesh.colors.shape == (count, 3)
    assert np.isfinite(mesh.vertices).all() and np.isfinite(mesh.normals).all()
    assert len(mesh.faces) and mesh.faces.min() >= 0 and mesh.faces.max() < count


def readers(folder: Path) -> dict[str, list[Case]]:
    """All cases by reader; valid files that HLP writes are made in a folder."""
    images = {"a.png": encoded(".png", COLORS), "d.png": encoded(".png", RAMP)}
    return {
        "bop": [
            *map(_of_scene, SCENE),
            case("t.json", TARGETS, lambda at: list_targets({}, at / "t.json", 0.1)),
            case("models_info.json", MODELS, _read_models),
            case("models/names.json", {"1": "ape"}, lambda at: name_objects(at, [1, 6])),
        ],
        "intrinsics": [*map(_intrinsics, INTRINSICS)],
        "numbers": [
            _numbers("a.rot", "3 3\n1 0 0\n0 1 0\n0 0 1\n", lambda at: read_numbers(at, 9, 1)),
            _numbers("a.tra", "1 3\n1.5\n-2\n100\n", lambda at: read_numbers(at, 3, 1)),
            _numbers("0.txt", "1 0 0 0.1\n0 1 0 0.2\n0 0 1 0.9\n0 0 0 1\n", read_pose),
        ],
        "images": [
            *(_image(f"a{end}", encoded(end, COLORS)) for end in (".png", ".jpg", ".bmp", ".webp")),
            _depth("d.png", images["d.png"]),
            _depth("d.tif", encoded(".tif", RAMP)),
            _depth("d.npy", _saved(np.save, RAMP / 1000.0)),
            _depth("d.dpt", np.array([6, 8], "<i4").tobytes() + RAMP.astype("<u2").tobytes()),
            case("a.npz", _saved(np.savez, a=RAMP, b=K), lambda at: read_npz(at / "a.npz")),
            case(
                "b.npz", _saved(np.savez_compressed, a=RAMP), lambda at: read_npz(at / "b.npz")
            ),
        ],
        "archives": [*map(_archive, ("a.zip", "a.tar", "a.tar.gz"))],
        "lines": [case("lines.txt", LINE, _lines, beside=images)],
        "report": [
            case(
                "report/index.json",
                {"objects": {"cat": WIRES}, "targets": [SCENE_3D]},
                _pictures,
                beside={"report/a.jpg": b"\xff\xd8\xff"},
                named="report",
            )
        ],
        "arguments": [
            case(
                "box.txt", "[1, 2.5, 30, 40]",
                lambda at: search_masks({"box": (at / "box.txt").read_text("utf-8", "replace")}),
                named="",
            )
        ],
        "meshes": [
            *(_mesh(name, content) for name, content in MESHES.items()),
            case("box.mtl", MTL, lambda at: read_mesh(at / "box.obj"),
                 beside={"box.obj": OBJ}, named="box."),
        ],
        **results(folder),
    }  # fmt: skip
