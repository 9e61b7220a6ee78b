"""`hlp live` in processes of its own, on a simulated camera and on frames in files."""

import json
import os
import signal
import subprocess
import sys
import time
import urllib.error
import urllib.request
from contextlib import suppress
from pathlib import Path

import cv2
import numpy as np
import pytest

import hlp
from forked_hlp import run_hlp
from frame_files import write_image
from hlp.data.synthetic.objects import demo_objects
from moving_scene import CAMERA, SimulatedCamera, is_right, path
from run_files import stated_pose

pytestmark = pytest.mark.slow

BEAR = next(model for model in demo_objects().values() if model.name == "bear")
POSES = path(BEAR, 4, (-0.05, -0.02, 0.7))
OWN = """
from moving_scene import SimulatedCamera, path
from hlp.data.synthetic.objects import demo_objects

def simulated():
    models = {model.name: model for model in demo_objects().values()}
    poses = path(models["bear"], 4, (-0.05, -0.02, 0.7))
    return SimulatedCamera({"bear": poses}, models)
"""
INTRINSICS = f"intrinsics=[{CAMERA[0, 0]},{CAMERA[1, 1]},{CAMERA[0, 2]},{CAMERA[1, 2]}]"
# Shells start tests in the background with Ctrl-C ignored, and children inherit that.
START = (
    "import signal; signal.signal(signal.SIGINT, signal.default_int_handler)\n"
    "from hlp.cli import main; main()"
)


def start(folder, *arguments):
    found = [str(Path(hlp.__file__).parents[1]), str(Path(__file__).parents[1])]
    return subprocess.Popen(
        [sys.executable, "-c", START, "live", "objects=bear", *arguments],
        cwd=folder,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(found)},
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def ended(process):
    """The remaining answers and the messages of a process."""
    out, messages = process.communicate(timeout=120)
    return [json.loads(line) for line in out.splitlines()], messages


def answer(process):
    return json.loads(process.stdout.readline())


@pytest.fixture(scope="module")
def images():
    return list(SimulatedCamera({"bear": POSES}, {"bear": BEAR}))


def write(folder, image):
    return write_image(folder, image.name, image)


def test_each_image_of_an_own_camera_is_answered(learnt, tmp_path):
    (tmp_path / "own.py").write_text(OWN)
    process = start(tmp_path, "source=own.py:simulated", f"learnt={learnt}", "overlay=last.png")
    (ready, *lines), messages = ended(process)
    assert process.returncode == 0, messages
    assert ready == {"ready": True, "objects": ["bear"]}
    assert [line["name"] for line in lines] == [f"{number:06d}" for number in range(4)]
    for number, (line, true) in enumerate(zip(lines, POSES, strict=True)):
        (found,) = line["found"]
        assert line["image"] == number and line["ms"] > 0.0 and line["missing"] == []
        assert found["object"] == "bear" and found["track"] == 0 and found["score"] >= 0.5
        assert found["tracked"] == (number > 0)
        assert is_right(stated_pose(found), true, BEAR)
    picture = cv2.imread(str(tmp_path / "last.png"))
    assert picture.shape == (240, 320, 3)
    assert not list(tmp_path.glob(".last*"))


def picture(address):
    """The last image, once one is drawn."""
    for _ in range(100):
        with suppress(urllib.error.HTTPError):
            return urllib.request.urlopen(address + "picture.jpg").read()  # noqa: S310
        time.sleep(0.1)
    raise AssertionError("nothing is drawn")


def test_a_folder_is_followed_until_ctrl_c(learnt, tmp_path, images):
    write(tmp_path, images[0])
    files = ("source=folder", "rgb=rgb", "depth=depth", INTRINSICS, "depth_scale=1")
    process = start(tmp_path, *files, f"learnt={learnt}", "page=0")
    assert answer(process)["ready"]
    assert [found["tracked"] for found in answer(process)["found"]] == [False]
    write(tmp_path, images[1])
    assert [found["tracked"] for found in answer(process)["found"]] == [True]
    address = process.stderr.readline().split()[1]
    assert cv2.imdecode(np.frombuffer(picture(address), np.uint8), 1).shape == (240, 320, 3)
    process.send_signal(signal.SIGINT)
    rest, messages = ended(process)
    assert process.returncode == 130
    assert rest == [] and messages == "hlp: interrupted\n"


def test_a_program_names_images_and_reads_answers(learnt, tmp_path, images):
    process = start(tmp_path, "source=stdin", f"learnt={learnt}", INTRINSICS, "depth_scale=1")
    assert answer(process)["ready"]
    for image, true in zip(images[:2], POSES, strict=False):
        process.stdin.write(json.dumps(write(tmp_path, image)) + "\n")
        process.stdin.flush()
        (found,) = answer(process)["found"]
        assert is_right(stated_pose(found), true, BEAR)
    process.stdin.write('{"rgb": "none.png", "depth": "none.png"}\n')
    process.stdin.flush()
    line = answer(process)
    assert line["image"] == 2 and line["error"].startswith("no image none.png")
    rest, messages = ended(process)
    assert (process.returncode, rest, messages) == (0, [], "")


def test_it_ends_when_nobody_reads_the_answers(learnt, tmp_path):
    (tmp_path / "own.py").write_text(OWN)
    with start(tmp_path, "source=own.py:simulated", f"learnt={learnt}") as process:
        assert answer(process)["ready"]
        process.stdout.close()
        assert process.stderr.read() == ""
    assert process.returncode == 141


@pytest.mark.parametrize(
    ("given", "words"),
    [
        (["learnt=x"], "source is not set"),
        (["source=usb", "learnt=x"], "must be folder, stdin, realsense or FILE.py:CLASS"),
        (["source=stdin", "learnt=x", "rgb=y"], "rgb is not a key of `hlp live`"),
        (["source=stdin", "learnt=nowhere", "work=."], "neither a folder of learnt objects"),
    ],
)
def test_what_is_wrong_is_said_in_one_line(tmp_path, given, words):
    said = run_hlp(tmp_path, "live", *given)
    assert (said.returncode, said.stdout) == (1, "")
    assert said.stderr.startswith("hlp: ") and words in said.stderr
    assert said.stderr.count("\n") == 1
