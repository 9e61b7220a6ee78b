"""`hlp predict` on frames of the demo dataset, written to files as a user would have them."""

import csv
import json
import os
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import trimesh
from hydra import compose, initialize_config_dir

import hlp
from hlp import Detector
from hlp.commands.composing import config_folder
from hlp.config.build import build_run, build_settings
from hlp.data.own_frames import OwnFrames
from hlp.data.synthetic.objects import demo_objects
from hlp.data.synthetic.scenes import SyntheticScenes, SyntheticSettings
from hlp.geometry import rotation_distance
from hlp.records import Frame, Target
from hlp.runs import prediction, runner

DRILL = 5
LOOKED_AT = (0, 2)  # frames in which the drill is near and in full view
TINY = (
    "encoder=pca",
    "rendering.coverage=hemisphere",
    "rendering.viewpoints=80",
    "rendering.in_plane_min_deg=-45",
    "rendering.in_plane_max_deg=45",
    "rendering.in_plane_steps=7",
    "patches.pool.per_object=900",
    "patches.pool.backgrounds=300",
    "patches.pairs.per_object=600",
    "classifier.epochs=4",
    "patches.pool.distractor_scenes=10",
    "classifier.min_batches=60",
    "score.scenes=6",
    "machine.threads=2",
)
FILES = {"model": "my drill.ply", "rgb": "rgb", "depth": "depth", "intrinsics": "camera.json"}
LEARNT = {"views", "classifier", "encoder", "codebook", "score"}
FOUND = {"regions", "hypotheses", "poses"}

Process = subprocess.CompletedProcess[str]


def hlp_predict(folder: Path, *arguments: str) -> Process:
    environment = {**os.environ, "PYTHONPATH": str(Path(hlp.__file__).parents[1])}
    return subprocess.run(
        [sys.executable, "-c", "from hlp.cli import main; main()", "predict", *arguments],
        cwd=folder,
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )


@dataclass(frozen=True)
class Own:
    """A folder (with a name that Hydra's overrides cannot hold bare) of a user's files."""

    folder: Path
    truths: tuple[Target, ...]

    @property
    def given(self) -> dict[str, str]:
        return {key: str(self.folder / name) for key, name in FILES.items()}


def write_frame(folder: Path, name: str, frame: Frame) -> None:
    bgr = cv2.cvtColor(frame.rgb, cv2.COLOR_RGB2BGR)
    cv2.imwrite(str(folder / "rgb" / f"{name}.png"), bgr)
    raw = np.rint(frame.depth * 10_000).astype(np.uint16)  # tenths of a millimetre
    cv2.imwrite(str(folder / "depth" / f"{name}.png"), raw)


@pytest.fixture(scope="module")
def own(tmp_path_factory: pytest.TempPathFactory) -> Own:
    folder = tmp_path_factory.mktemp("predict") / "files (of Ann's, mine)"
    for kind in ("rgb", "depth"):
        (folder / kind).mkdir(parents=True)
    scenes = SyntheticScenes(
        SyntheticSettings(width=320, height=240, objects=(5, 5), clutter=(1, 3))
    )
    frames = [scenes.load(scenes.keys[number]) for number in LOOKED_AT]
    for number, frame in zip(LOOKED_AT, frames, strict=True):
        write_frame(folder, f"view_{number}", frame)
    camera = {"cam_K": frames[0].camera_matrix.ravel().tolist(), "depth_scale": 0.1}
    (folder / "camera.json").write_text(json.dumps(camera))
    mesh = demo_objects()[DRILL].mesh
    raw = trimesh.Trimesh(
        mesh.vertices * 1000.0, mesh.faces, vertex_colors=mesh.colors, process=False
    )
    raw.export(folder / "my drill.ply")
    truths = [t for frame in frames for t in frame.targets if t.object_id == DRILL]
    return Own(folder, tuple(truths))


@pytest.fixture(scope="module")
def first(own: Own) -> Process:
    process = hlp_predict(own.folder, *arguments(own.given), *TINY, "output=first")
    assert process.returncode == 0, process.stderr
    return process


def arguments(given: dict[str, str]) -> list[str]:
    return [f"{key}={value}" for key, value in given.items()]


def answers(folder: Path) -> list[dict[str, Any]]:
    poses: list[dict[str, Any]] = json.loads((folder / "poses.json").read_text())["poses"]
    return poses


def test_poses_are_near_the_true_ones(own: Own, first: Process) -> None:
    found = answers(own.folder / "first")
    assert [Path(each["rgb"]).name for each in found] == ["view_0.png", "view_2.png"]
    for each, truth in zip(found, own.truths, strict=True):
        assert each["found"] and 0.0 < each["score"] <= 1.0
        shift = np.array(each["cam_t_m2c"]) / 1000.0 - truth.pose_cam_obj[:3, 3]
        assert np.linalg.norm(shift) < 0.03
        rotation = np.array(each["cam_R_m2c"]).reshape(3, 3)
        turn = rotation_distance(rotation, truth.pose_cam_obj[:3, :3])
        assert np.rad2deg(turn) < 20.0


def test_every_form_of_the_answer_says_the_same(own: Own, first: Process) -> None:
    output = own.folder / "first"
    with (output / "poses.csv").open(newline="") as stream:
        rows = list(csv.DictReader(stream))
    for row, each in zip(rows, answers(output), strict=True):
        np.testing.assert_allclose([float(v) for v in row["t"].split()], each["cam_t_m2c"])
        np.testing.assert_allclose([float(v) for v in row["R"].split()], each["cam_R_m2c"])
        name = Path(each["rgb"]).name
        (line,) = (line for line in first.stdout.splitlines() if line.startswith(name))
        shown = [f"{value:.1f}" for value in each["cam_t_m2c"]]
        assert line.split()[1:6] == ["my", "drill", f"{each['score']:.2f}", *shown[:2]]
        picture = cv2.imread(str(output / "panels" / name))
        assert picture is not None and picture.shape[1] == 640
    assert str(output) in first.stdout
    assert not (own.folder / "work" / "mlflow.db").exists()


def test_new_frames_are_looked_at_without_learning_again(own: Own, first: Process) -> None:
    """One known frame and one in which the sensor saw next to nothing."""
    for kind in ("rgb", "depth"):
        (own.folder / "new" / kind).mkdir(parents=True)
        name = own.folder / kind / "view_2.png"
        (own.folder / "new" / kind / "view_2.png").write_bytes(name.read_bytes())
    blank = np.zeros((240, 320), np.uint16)
    blank[0, 0] = 9000
    cv2.imwrite(str(own.folder / "new" / "rgb" / "blank.png"), np.zeros((240, 320, 3), np.uint8))
    cv2.imwrite(str(own.folder / "new" / "depth" / "blank.png"), blank)
    given = arguments(FILES | {"rgb": "new/rgb", "depth": "new/depth"})
    again = hlp_predict(own.folder, *given, *TINY, "output=again", "panels=0")
    assert again.returncode == 0, again.stderr
    lines = [line.split()[:2] for line in again.stdout.splitlines() if line.strip()]
    assert {line[1] for line in lines if line[0] == "reused"} >= LEARNT
    assert {line[1] for line in lines if line[0] == "made"} == FOUND
    blank_answer, answer = answers(own.folder / "again")
    assert answer["found"] and not blank_answer["found"]
    assert blank_answer["score"] == 0.0
    assert "not found" in again.stdout
    assert len((own.folder / "again" / "poses.csv").read_text().splitlines()) == 2
    assert not (own.folder / "again" / "panels").exists()


def test_help_says_what_to_give_and_what_is_missing_is_named(tmp_path: Path) -> None:
    shown = hlp_predict(tmp_path, "--help")
    assert shown.returncode == 0
    assert "hlp predict model=bracket.ply" in shown.stdout
    failed = hlp_predict(tmp_path, "model=a.ply", "rgb=a.png", "intrinsics=[1,1,1,1]")
    assert failed.returncode == 1
    assert failed.stderr == "hlp: depth is not set: give depth=…, see `hlp predict --help`\n"


def composed(own: Own, **changes: Any) -> Any:
    """The configuration for the user's files, with changes below `data`."""
    with initialize_config_dir(str(config_folder()), version_base="1.3"):
        config = compose("config", overrides=["experiment=predict", "output=out"])
    for key, value in (own.given | changes).items():
        config.data[key] = value
    return config


def test_wrong_input_is_named_before_anything_is_learnt(own: Own, tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"model: .*wrong unit.*mesh_scale"):
        build_run(composed(own, mesh_scale=1.0))
    with pytest.raises(FileNotFoundError, match=r"data\.rooms is no folder"):
        build_run(composed(own, rooms="nowhere"))
    with pytest.raises(ValueError, match="principal point"):
        prediction.predict(build_run(composed(own, intrinsics=[500, 500, 600, 9])), tmp_path)
    assert list(tmp_path.iterdir()) == []


def test_each_command_refuses_the_others_frames(own: Own, tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="no true poses"):
        runner.run_method(build_run(composed(own)), tmp_path)
    with initialize_config_dir(str(config_folder()), version_base="1.3"):
        demo = compose("config", overrides=[f"output={tmp_path}"])
    with pytest.raises(ValueError, match="data=files alone"):
        prediction.predict(build_run(demo), tmp_path)


def test_the_python_api_finds_the_same_poses(own: Own, first: Process, tmp_path: Path) -> None:
    """One code path: what `hlp predict` learns and finds, `Detector` does, to the last bit."""
    given = [f"data.{key}='{value}'" for key, value in own.given.items()]
    with initialize_config_dir(str(config_folder().absolute()), version_base="1.3"):
        config = compose("config", ["experiment=predict", "output=o", *TINY, *escaped(given)])
    mesh = Path(own.given["model"])
    settings = build_settings(config).method
    detector = Detector.learn({mesh.stem: mesh}, tmp_path / "learnt", settings=settings)
    frames = OwnFrames(
        *(Path(own.given[key]) for key in ("rgb", "depth")), own.given["intrinsics"], None
    )
    frame = frames.load(frames.keys[0])  # numbered 0, as every image is for a detector
    (found,) = detector.detect(frame.rgb, frame.depth, frame.camera_matrix)
    answers = json.loads((own.folder / "first" / "poses.json").read_text())["poses"]
    expected = answers[0]
    pose = found.pose_cam_obj
    assert (pose[:3, :3].ravel().tolist(), (pose[:3, 3] * 1000.0).tolist()) == (
        expected["cam_R_m2c"],
        expected["cam_t_m2c"],
    )
    assert found.score == expected["score"]


def escaped(overrides: list[str]) -> list[str]:
    """Quotes within quoted values, as Hydra wants them."""
    return [
        f"{key}='{value[1:-1].replace(chr(39), chr(92) + chr(39))}'"
        for key, _, value in (each.partition("=") for each in overrides)
    ]
