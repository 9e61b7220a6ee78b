"""The shipped defaults, end to end: what newcomers and engineers run; the gate is recall."""

import json
from pathlib import Path

import cv2
import numpy as np
import pytest

from hlp import Detector
from hlp.data.rgbd_frames import RgbdFrames
from hlp.evaluation.errors import add
from hlp.method.learn.model_files import read_model
from tiny_run import start_run

INTRINSICS = np.array([[572.4114, 0, 325.2611], [0, 573.57043, 242.04899], [0, 0, 1.0]])


@pytest.mark.slow
def test_the_demo_finds_its_objects(tmp_path: Path) -> None:
    """`make demo` with nothing changed: measured .94, of 142 targets."""
    done = start_run(tmp_path, "output=demo", threads=2)
    assert done.returncode == 0, done.stderr
    summary = json.loads((tmp_path / "demo" / "summary.json").read_text())
    assert summary["targets"] == 142
    assert summary["metrics"]["add"]["recall"] >= 0.88
    assert summary["metrics"]["5cm5deg"]["recall"] >= 0.82


@pytest.mark.slow
def test_the_cat_is_found_in_real_frames_by_the_python_api(
    shared_data: Path, tmp_path: Path
) -> None:
    """Learnt alone, from its CAD model, with nothing set: every tenth of its frames.

    Measured 1.00; without the closer look at likely places .65 to .75.
    """
    rooms = RgbdFrames(shared_data / "rooms")
    mesh = shared_data / "lm" / "models" / "obj_000006.ply"
    frames = [rooms.load(key) for key in rooms.keys]
    detector = Detector.learn({"cat": mesh}, tmp_path / "learnt", background_frames=frames)
    scene = shared_data / "lm" / "test" / "000006"
    truth = json.loads((scene / "scene_gt.json").read_text())
    model = read_model(tmp_path / "learnt" / "objects" / "cat")
    right = []
    for image in sorted(truth, key=int)[::10]:
        (annotated,) = [each for each in truth[image] if each["obj_id"] == 6]
        pose = np.eye(4)
        pose[:3, :3] = np.reshape(annotated["cam_R_m2c"], (3, 3))
        pose[:3, 3] = np.array(annotated["cam_t_m2c"]) / 1000.0
        bgr = cv2.imread(str(scene / "rgb" / f"{int(image):06d}.jpg"))
        raw = cv2.imread(str(scene / "depth" / f"{int(image):06d}.png"), cv2.IMREAD_UNCHANGED)
        rgb = cv2.cvtColor(bgr, cv2.COLOR_BGR2RGB)
        found = detector.detect(rgb, (raw / 1000.0).astype(np.float32), INTRINSICS)
        right.append(
            bool(found)
            and add(found[0].pose_cam_obj, pose, model.mesh.vertices) < 0.1 * model.diameter
        )
    assert len(right) == 20
    assert np.mean(right) >= 0.85
