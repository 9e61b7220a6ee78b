"""`hlp learn` and `hlp predict` on frames of the demo in files, as a user would have them."""

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

import hlp
from hlp import Detector
from hlp.commands import learn
from hlp.commands.composing import compose_config
from hlp.config.build import build_settings
from hlp.data.own_frames import FrameFiles, OwnFrames
from hlp.data.synthetic.objects import demo_objects
from hlp.data.synthetic.scenes import SyntheticScenes, SyntheticSettings
from hlp.geometry import rotation_distance
from hlp.records import Frame, Target

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

Process = subprocess.CompletedProcess[str]


def call(folder: Path, *arguments: str) -> Process:
    environment = {**os.environ, "PYTHONPATH": str(Path(hlp.__file__).parents[1])}
    return subprocess.run(
        [sys.executable, "-c", "from hlp.cli import main; main()", *arguments],
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
    process = call(
        own.folder, "predict", *arguments(own.given), *TINY, "output=first", "panels=9", "work=work"
    )
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
    lines = [json.loads(line) for line in (output / "poses.jsonl").read_text().splitlines()]
    assert lines == answers(output)
    for row, each in zip(rows, answers(output), strict=True):
        np.testing.assert_allclose([float(v) for v in row["t"].split()], each["cam_t_m2c"])
        np.testing.assert_allclose([float(v) for v in row["R"].split()], each["cam_R_m2c"])
        name = Path(each["rgb"]).stem
        (line,) = (line for line in first.stdout.splitlines() if line.startswith(name))
        shown = [f"{value:.1f}" for value in each["cam_t_m2c"]]
        assert line.split()[1:6] == ["my", "drill", f"{each['score']:.2f}", *shown[:2]]
        picture = cv2.imread(str(output / "panels" / f"{name}.png"))
        assert picture is not None and picture.shape == (240, 320, 3)
    assert str(output.relative_to(own.folder)) in first.stdout
    assert "mm, " in first.stdout and "symmetries" in first.stdout  # what was found in the mesh


@pytest.mark.slow
def test_new_frames_are_looked_at_without_learning_again(own: Own, first: Process) -> None:
    """One known frame, one in which nothing is seen, and one that is broken."""
    for kind in ("rgb", "depth"):
        (own.folder / "new" / kind).mkdir(parents=True)
        name = own.folder / kind / "view_2.png"
        (own.folder / "new" / kind / "view_2.png").write_bytes(name.read_bytes())
        (own.folder / "new" / kind / "broken.png").write_bytes(name.read_bytes()[:2000])
    blank = np.zeros((240, 320), np.uint16)
    blank[0, 0] = 9000
    cv2.imwrite(str(own.folder / "new" / "rgb" / "blank.png"), np.zeros((240, 320, 3), np.uint8))
    cv2.imwrite(str(own.folder / "new" / "depth" / "blank.png"), blank)
    given = arguments(FILES | {"rgb": "new/rgb", "depth": "new/depth"})
    again = call(own.folder, "predict", *given, *TINY, "output=again", "work=work")
    assert again.returncode == 0, again.stderr
    assert "learnt before" in again.stdout
    blank_answer, broken, answer = answers(own.folder / "again")
    assert answer["found"] and not blank_answer["found"]
    assert blank_answer["score"] == 0.0 and "has depth" in blank_answer["reason"]
    assert (
        "broken.png is truncated" in broken["error"] and "broken.png is truncated" in again.stdout
    )
    assert "not found" in again.stdout and "1 of 3 frames could not be used" in again.stdout
    assert len((own.folder / "again" / "poses.csv").read_text().splitlines()) == 2
    assert not (own.folder / "again" / "panels").exists()
    one = arguments(FILES | {"rgb": "new/rgb/broken.png", "depth": "new/depth/broken.png"})
    failed = call(own.folder, "predict", *one, *TINY, "output=failed", "work=work")
    assert failed.returncode == 1
    assert failed.stderr.startswith("hlp: new/rgb/broken.png is truncated")


def test_learnt_objects_are_used_by_name_and_by_path(own: Own, first: Process) -> None:
    """What the first call learnt has a name in the cache; a box where nothing is finds nothing."""
    listed = call(own.folder, "objects", "list", "work=work").stdout.splitlines()
    (entry,) = (line for line in listed if line.startswith("my drill"))
    name = entry.partition("  ")[0].strip()
    shown = call(own.folder, "objects", "show", name, "work=work").stdout
    assert "my drill (id 1)" in shown and "symmetries" in shown
    frames = arguments({key: FILES[key] for key in ("rgb", "depth", "intrinsics")})
    learnt = f"learnt={name}"
    done = call(own.folder, "predict", learnt, *frames, "work=work", "output=second")
    assert done.returncode == 0, done.stderr
    again = answers(own.folder / "second")
    assert [each["cam_t_m2c"] for each in again] == [
        each["cam_t_m2c"] for each in answers(own.folder / "first")
    ]
    copied = call(own.folder, "objects", "export", name, "copy", "work=work")
    assert copied.returncode == 0, copied.stderr
    boxed = call(
        own.folder, "predict", "learnt=copy", *frames, "box=0,0,12,12", "output=boxed",
        "min_score=0.9",
    )  # fmt: skip
    assert boxed.returncode == 0, boxed.stderr
    assert not any(each["found"] for each in answers(own.folder / "boxed"))


@pytest.mark.parametrize(
    ("given", "words"),
    [
        (["names=a"], "mesh is not set"),
        (["mesh=none.ply"], "there is no mesh none.ply"),
        (["mesh=my drill.ply", "names=a,b"], "names: a, b for 1 meshes"),
        (["mesh=my drill.ply", "mesh_scale=1"], "wrong unit"),
        (["mesh=my drill.ply", "rooms=nowhere"], "rooms is no folder"),
        (["mesh=my drill.ply", "symetries=none"], "symetries"),
        (["mesh=my drill.ply", "name=a/b"], "give output"),
    ],
)
def test_learning_says_what_is_wrong_before_it_begins(
    own: Own,
    given: list[str],
    words: str,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(own.folder)
    with pytest.raises(SystemExit) as ended:
        learn.command([*given, "work=work"])
    said = capsys.readouterr().err
    assert ended.value.code == 1
    assert said.startswith("hlp: ") and words in said


def test_help_says_what_to_give_and_what_is_missing_is_named(tmp_path: Path) -> None:
    shown = call(tmp_path, "predict", "--help")
    assert shown.returncode == 0
    assert "hlp predict model=bracket.ply" in shown.stdout
    failed = call(tmp_path, "predict", "model=a.ply", "rgb=a.png", "intrinsics=[1,1,1,1]")
    assert failed.returncode == 1
    assert failed.stderr == "hlp: depth is not set: give depth=…, see `hlp predict --help`\n"
    for command in ("learn", "objects"):
        assert call(tmp_path, command, "--help").stdout.startswith(f"usage: hlp {command}")


def test_wrong_frames_are_named_before_anything_is_learnt(own: Own) -> None:
    given = own.given | {"intrinsics": "[500,500,600,9]"}
    failed = call(own.folder, "predict", *arguments(given), *TINY, "work=untouched")
    assert failed.returncode == 1 and "principal point" in failed.stderr
    assert not (own.folder / "untouched").exists()


@pytest.mark.slow
def test_the_python_api_finds_the_same_poses(own: Own, first: Process, tmp_path: Path) -> None:
    """One code path: what `hlp predict` learns and finds, `Detector` does, to the last bit."""
    general = ("output=o", "~experiment", "name=learn", "data=bop", "data.root=.")
    settings = build_settings(compose_config(*general, *TINY)).method
    mesh = Path(own.given["model"])
    detector = Detector.learn({mesh.stem: mesh}, tmp_path / "learnt", settings=settings)
    files = {key: own.given[key] for key in ("rgb", "depth", "intrinsics")}
    frames = OwnFrames(FrameFiles(**files))
    frame = frames.load(frames.keys[0])  # numbered 0, as every image is for a detector
    (found,) = detector.detect(frame.rgb, frame.depth, frame.camera_matrix)
    expected = answers(own.folder / "first")[0]
    pose = found.pose_cam_obj
    assert (pose[:3, :3].ravel().tolist(), (pose[:3, 3] * 1000.0).tolist()) == (
        expected["cam_R_m2c"],
        expected["cam_t_m2c"],
    )
    assert found.score == expected["score"]
