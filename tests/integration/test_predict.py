"""`hlp learn` and `hlp predict` on frames of the demo in files, as a user would have them."""

import json
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import pytest

from composed_settings import run_settings
from forked_hlp import run_hlp, succeed
from frame_files import write_camera, write_image
from hlp import Detector
from hlp.data.own_frames import FrameFiles, OwnFrames
from hlp.data.synthetic.objects import demo_objects
from hlp.data.synthetic.scenes import SyntheticScenes, SyntheticSettings
from hlp.geometry import rotation_distance
from hlp.records import Target
from run_files import read_json, stated_pose
from table_text import csv_rows
from tiny_method import LEARNS_WELL, write_mesh

DRILL = 5
TENTHS = 10_000.0  # of a millimetre, the unit of depth in files
LOOKED_AT = (0, 2)  # frames in which the drill is near and in full view
TINY = (
    *(*LEARNS_WELL, "encoder=pca", "rendering.viewpoints=80"),
    *("patches.pool.backgrounds=300", "machine.threads=2"),
)
FILES = {"model": "my drill.ply", "rgb": "rgb", "depth": "depth", "intrinsics": "camera.json"}


@dataclass(frozen=True)
class Own:
    """A folder (with a name that Hydra's overrides cannot hold bare) of a user's files."""

    folder: Path
    truths: tuple[Target, ...]

    @property
    def given(self):
        return {key: str(self.folder / name) for key, name in FILES.items()}

    def predict(self, output, *arguments, call=succeed, **given):
        """`hlp predict` with KEY=VALUE as `given`."""
        pairs = (f"{key}={value}" for key, value in given.items())
        return call(self.folder, "predict", *pairs, *arguments, f"output={output}", "work=work")

    def answers(self, output):
        return read_json(self.folder / output / "poses.json")["poses"]


@pytest.fixture(scope="module")
def own(tmp_path_factory):
    folder = tmp_path_factory.mktemp("predict") / "files (of Ann's, mine)"
    settings = SyntheticSettings(width=320, height=240, objects=(5, 5), clutter=(1, 3))
    scenes = SyntheticScenes(settings)
    frames = [scenes.load(scenes.keys[number]) for number in LOOKED_AT]
    for number, frame in zip(LOOKED_AT, frames, strict=True):
        write_image(folder, f"view_{number}", frame, TENTHS)
    write_camera(folder, frames[0], TENTHS)
    write_mesh(folder, demo_objects()[DRILL]).rename(folder / "my drill.ply")
    truths = [t for frame in frames for t in frame.targets if t.object_id == DRILL]
    return Own(folder, tuple(truths))


@pytest.fixture(scope="module")
def first(own):
    return own.predict("first", *TINY, "panels=9", **own.given)


@pytest.mark.slow
def test_poses_are_near_the_true_ones(own, first):
    found = own.answers("first")
    assert [Path(answer["rgb"]).name for answer in found] == ["view_0.png", "view_2.png"]
    for answer, truth in zip(found, own.truths, strict=True):
        assert answer["found"] and 0.0 < answer["score"] <= 1.0
        pose, true = stated_pose(answer), truth.pose_cam_obj
        assert np.linalg.norm(pose[:3, 3] - true[:3, 3]) < 0.03
        assert np.rad2deg(rotation_distance(pose[:3, :3], true[:3, :3])) < 20.0


@pytest.mark.slow
def test_every_form_of_the_answer_says_the_same(own, first):
    output, found = own.folder / "first", own.answers("first")
    lines = [json.loads(line) for line in (output / "poses.jsonl").read_text().splitlines()]
    assert lines == found
    for row, answer in zip(csv_rows(output / "poses.csv"), found, strict=True):
        for key, kept in (("t", "cam_t_m2c"), ("R", "cam_R_m2c")):
            np.testing.assert_allclose([float(v) for v in row[key].split()], answer[kept])
        name = Path(answer["rgb"]).stem
        (line,) = (line for line in first.stdout.splitlines() if line.startswith(name))
        shown = [f"{value:.1f}" for value in answer["cam_t_m2c"]]
        assert line.split()[1:6] == ["my", "drill", f"{answer['score']:.2f}", *shown[:2]]
        picture = cv2.imread(str(output / "panels" / f"{name}.png"))
        assert picture is not None and picture.shape == (240, 320, 3)
    assert "first" in first.stdout
    assert "mm, " in first.stdout and "symmetries" in first.stdout  # what was found in the mesh


@pytest.mark.slow
def test_new_frames_are_looked_at_without_learning_again(own, first):
    """One known frame, one in which nothing is seen, and one that is broken."""
    new = own.folder / "new"
    for kind in ("rgb", "depth"):
        (new / kind).mkdir(parents=True)
        image = (own.folder / kind / "view_2.png").read_bytes()
        (new / kind / "view_2.png").write_bytes(image)
        (new / kind / "broken.png").write_bytes(image[:2000])
    blank = np.zeros((240, 320), np.uint16)
    blank[0, 0] = 9000
    cv2.imwrite(str(new / "rgb" / "blank.png"), np.zeros((240, 320, 3), np.uint8))
    cv2.imwrite(str(new / "depth" / "blank.png"), blank)
    again = own.predict("again", *TINY, **FILES | {"rgb": "new/rgb", "depth": "new/depth"})
    assert "already learnt" in again.stdout
    blank_answer, broken, answer = own.answers("again")
    assert answer["found"] and not blank_answer["found"]
    assert blank_answer["score"] == 0.0 and "has depth" in blank_answer["reason"]
    assert "broken.png is truncated" in broken["error"]
    for words in ("broken.png is truncated", "not found", "1 of 3 frames could not be used"):
        assert words in again.stdout
    assert len(csv_rows(own.folder / "again" / "poses.csv")) == 1
    assert not (own.folder / "again" / "panels").exists()
    one = FILES | {"rgb": "new/rgb/broken.png", "depth": "new/depth/broken.png"}
    failed = own.predict("failed", *TINY, call=run_hlp, **one)
    assert failed.returncode == 1
    assert failed.stderr.startswith("hlp: new/rgb/broken.png is truncated")


@pytest.mark.slow
def test_learnt_objects_are_used_by_name_and_by_path(own, first):
    """What the first call learnt has a name in the cache; a box where nothing is finds nothing."""

    def objects(*words):
        return succeed(own.folder, "objects", *words, "work=work").stdout

    (entry,) = (line for line in objects("list").splitlines() if line.startswith("my drill"))
    name = entry.partition("  ")[0].strip()
    shown = objects("show", name)
    assert "my drill (id 1)" in shown and "symmetries" in shown
    frames = {key: FILES[key] for key in ("rgb", "depth", "intrinsics")}
    own.predict("second", f"learnt={name}", **frames)
    before, after = (
        [answer["cam_t_m2c"] for answer in own.answers(output)] for output in ("first", "second")
    )
    assert before == after
    objects("export", name, "copy")
    own.predict("boxed", "learnt=copy", "box=0,0,12,12", "min_score=0.9", **frames)
    assert not any(answer["found"] for answer in own.answers("boxed"))


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["learn", "mesh=none.ply"], "there is no mesh none.ply"),
        (["learn", "mesh=my drill.ply", "names=a,b"], "names: a, b for 1 meshes"),
        (["learn", "mesh=my drill.ply", "mesh_scale=1"], "wrong unit"),
        (["learn", "mesh=my drill.ply", "symetries=none"], "symetries"),
        (["learn", "mesh=my drill.ply", "name=a/b"], "give output"),
        (
            ["predict", "model=a.ply", "rgb=a.png", "intrinsics=[1,1,1,1]"],
            "depth is not set: give depth=…, see `hlp predict --help`\n",
        ),
        (
            [
                *("predict", *TINY, "model=my drill.ply", "rgb=rgb", "depth=depth"),
                *("intrinsics=[500,500,600,9]", "output=never"),
            ],
            "principal point",
        ),
    ],
)
def test_what_is_wrong_is_said_before_anything_is_learnt(own, words, said, monkeypatch, fails):
    monkeypatch.chdir(own.folder)
    error = fails(*words, "work=work")
    assert error.startswith("hlp: ") and said in f"{error}\n"
    assert not (own.folder / "never").exists()


@pytest.mark.slow
def test_the_python_api_finds_the_same_poses(own, first, tmp_path):
    """One code path: what `hlp predict` learns and finds, `Detector` does, to the last bit."""
    general = ("~experiment", "name=learn", "data=bop", "data.root=.")
    settings = run_settings(*general, *TINY).method
    mesh = Path(own.given["model"])
    detector = Detector.learn({mesh.stem: mesh}, tmp_path / "learnt", settings=settings)
    files = {key: own.given[key] for key in ("rgb", "depth", "intrinsics")}
    frames = OwnFrames(FrameFiles(**files))
    frame = frames.load(frames.keys[0])  # numbered 0, as every image is for a detector
    (found,) = detector.detect(frame.rgb, frame.depth, frame.camera_matrix)
    expected, pose = own.answers("first")[0], found.pose_cam_obj
    assert pose[:3, :3].ravel().tolist() == expected["cam_R_m2c"]
    assert (pose[:3, 3] * 1000.0).tolist() == expected["cam_t_m2c"]
    assert found.score == expected["score"]
