"""Tracking and `hlp live` on real frames, which are skipped where they are absent."""

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import hlp
from hlp import Detector
from hlp.data.bop import BopSettings
from hlp.evaluation.errors import add, add_s
from hlp.method.track.tracking import Track
from hlp.records import Frame, ObjectModel
from tiny_method import tiny_method

PLAYER = """
from hlp import CameraImage
from hlp.data.bop import BopSettings

def player():
    frames = BopSettings(root={root!r}).build().frames
    for key in frames.keys[:6]:
        frame = frames.load(key)
        yield CameraImage(frame.rgb, frame.depth, frame.camera_matrix, key)
"""


def recording(shared_data: Path, name: str) -> tuple[list[Frame], Path]:
    root = shared_data / name
    if not root.is_dir():
        pytest.skip(f"development data is absent: no {root}")
    source = BopSettings(root=str(root)).build().frames
    (mesh,) = (root / "models").glob("*.ply")
    return [source.load(key) for key in source.keys], mesh


@pytest.mark.slow
def test_a_bottle_in_a_robots_hand_is_followed(shared_data: Path, tmp_path: Path) -> None:
    """From a pose that is known; these frames lie a tenth of a second apart."""
    frames, mesh = recording(shared_data, "mustard")
    frames = [frame for frame in frames if frame.frame_id >= 14]
    detector = Detector.learn(
        {"mustard": mesh}, tmp_path / "learnt", settings=tiny_method(), mesh_scale=0.001
    )
    model = detector.models["mustard"]
    tracker = detector.tracker(max_instances=1)
    start = frames[0].targets[0].pose_cam_obj
    tracker._tracks = (Track(0, model.object_id, 1.0, start),)
    for frame in frames[1:]:
        (found,) = tracker.update(frame)
        true = frame.targets[0].pose_cam_obj
        assert found.tracked and found.track == 0
        assert add(found.pose_cam_obj, true, model.mesh.vertices) < 0.1 * model.diameter


@pytest.mark.slow
def test_a_recording_is_played_to_hlp_live(shared_data: Path, tmp_path: Path) -> None:
    """Three cups that stand elsewhere in each frame: most are found, by whichever way."""
    frames, mesh = recording(shared_data, "cup")
    detector = Detector.learn(
        {"cup": mesh},
        tmp_path / "learnt",
        settings=tiny_method("rendering.viewpoints=200", "classifier.epochs=6"),
        mesh_scale=0.001,
    )
    player = PLAYER.format(root=str(shared_data / "cup"))
    (tmp_path / "player.py").write_text(player)
    done = subprocess.run(
        [sys.executable, "-c", "from hlp.cli import main; main()", "live",
         "source=player.py:player", "learnt=learnt", "max_instances=3"],
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": str(Path(hlp.__file__).parents[1])},
        capture_output=True,
        text=True,
        check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    ready, *lines = map(json.loads, done.stdout.splitlines())
    assert ready["ready"] and len(lines) == 6
    model = detector.models["cup"]
    right = sum(
        is_found(line["found"], target.pose_cam_obj, model)
        for line, frame in zip(lines, frames, strict=False)
        for target in frame.targets
    )
    assert right >= 9  # of 18


def is_found(answers: list[dict[str, list[float]]], true: np.ndarray, model: ObjectModel) -> bool:
    for each in answers:
        pose = np.eye(4)
        pose[:3, :3] = np.reshape(each["cam_R_m2c"], (3, 3))
        pose[:3, 3] = np.array(each["cam_t_m2c"]) / 1000.0
        if add_s(pose, true, model.mesh.vertices) < 0.1 * model.diameter:
            return True
    return False
