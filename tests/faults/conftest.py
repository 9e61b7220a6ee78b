"""The run that the tests of this folder disturb: smaller still than that of all other tests."""

import json
import os
import subprocess
from pathlib import Path

import cv2
import numpy as np
import pytest
import trimesh

from hlp.data.synthetic.objects import demo_objects
from hlp.data.synthetic.scenes import SyntheticScenes, SyntheticSettings
from hlp.records import Frame
from made_once import made_once
from tiny_run import TINY, TinyRun, start_run

os.environ.setdefault("MLFLOW_DISABLE_TELEMETRY", "true")  # it is imported before HLP could say so

SCENES = SyntheticSettings(scenes=2, width=320, height=240, objects=(5, 5), clutter=(1, 3))
OBJECTS = 2


@pytest.fixture(scope="session")
def scenes() -> SyntheticScenes:
    """The frames of all tests here."""
    return SyntheticScenes(SCENES)


@pytest.fixture(scope="session")
def tiny_run(tmp_path_factory: pytest.TempPathFactory, scenes: SyntheticScenes) -> TinyRun:
    """A run of two objects in two frames, which are files."""

    def make(folder: Path) -> None:
        write_set(folder / "set", scenes)
        process = start_run(folder, *overrides_in(folder), "output=first", threads=2)
        assert process.returncode == 0, process.stderr
        said = [process.stdout, process.stderr, str(folder)]
        (folder / "said.json").write_text(json.dumps(said))

    folder = made_once(tmp_path_factory, "faults", make)
    out, err, made_in = json.loads((folder / "said.json").read_text())
    process = subprocess.CompletedProcess([], 0, out, err)
    overrides = overrides_in(Path(made_in))
    return TinyRun(folder, folder / "first", overrides, process, Path(made_in))


def overrides_in(folder: Path) -> tuple[str, ...]:
    """The run's settings, with the data set in a folder."""
    settings = (each for each in TINY if not each.startswith("data."))
    return ("data=bop", f"data.root={folder / 'set'}", *settings)


def write_set(root: Path, scenes: SyntheticScenes) -> None:
    """Two of the demo's scenes in BOP's layout, with two of its objects annotated."""
    frames = [scenes.load(key) for key in scenes.keys]
    both = set.intersection(*({each.object_id for each in frame.targets} for frame in frames))
    chosen = sorted(both)[:OBJECTS]
    assert len(chosen) == OBJECTS
    (root / "models").mkdir(parents=True)
    for object_id in chosen:
        mesh = demo_objects()[object_id].mesh
        scaled = trimesh.Trimesh(
            mesh.vertices * 1000.0, mesh.faces, vertex_colors=mesh.colors, process=False
        )
        scaled.export(root / "models" / f"obj_{object_id:06d}.ply")
    for number, frame in enumerate(frames):
        _write_scene(root / "test" / f"{number:06d}", frame, chosen)


def _write_scene(folder: Path, frame: Frame, chosen: list[int]) -> None:
    for kind, image in (
        ("rgb", frame.rgb[..., ::-1]),
        ("depth", np.rint(frame.depth * 1000.0).astype(np.uint16)),
    ):
        (folder / kind).mkdir(parents=True)
        cv2.imwrite(str(folder / kind / "000000.png"), image)
    targets = [each for each in frame.targets if each.object_id in chosen]
    truth = [
        {
            "obj_id": each.object_id,
            "cam_R_m2c": each.pose_cam_obj[:3, :3].ravel().tolist(),
            "cam_t_m2c": (each.pose_cam_obj[:3, 3] * 1000.0).tolist(),
        }
        for each in targets
    ]
    camera = {"cam_K": frame.camera_matrix.ravel().tolist(), "depth_scale": 1.0}
    info = [{"visib_fract": float(each.visible_fraction)} for each in targets]
    for name, content in (("camera", camera), ("gt", truth), ("gt_info", info)):
        (folder / f"scene_{name}.json").write_text(json.dumps({"0": content}))
