"""`predict` around a detector that stands in for the real one: what is said, and when."""

import json
import logging
import os
import re
import threading
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from frame_files import write_flat
from hlp.checks import Finding, known_objects
from hlp.data.own_frames import FrameFiles, OwnFrames
from hlp.data.synthetic.objects import demo_objects
from hlp.errors import DamagedError, DataError, InputError
from hlp.method.find.detections import Detection, Rejection, SearchResult
from hlp.refinement.pose_fit import PoseFit
from hlp.runs.prediction import HEADER, PredictionOptions, detection_values, pose_line, predict

FILES = ("poses.csv", "poses.json", "poses.jsonl")


class Nothing:
    """A detector that finds nothing, of an object that it knows; it may be stopped at a call."""

    def __init__(self, folder):
        self.models = {m.name: m for m in demo_objects().values() if m.name == "bear"}
        self.folder, self.objects = folder, ("bear",)
        self.searched, self.stopped_at = 0, -1
        self.stop: BaseException = KeyboardInterrupt()

    def search(self, *_):
        self.searched += 1
        if self.searched == self.stopped_at:
            raise self.stop
        return SearchResult([], [Rejection("bear", "nothing looks like it", None)])


@pytest.fixture
def detector(tmp_path):
    (tmp_path / "learnt").mkdir()
    (tmp_path / "learnt" / "learnt.json").write_text("{}")
    return Nothing(tmp_path / "learnt")


def frames(folder, broken=(), count=3, scale=1.0):
    for i in range(count):
        write_flat(folder, f"{i}.png", 0, 700, (24, 32))
    for i in broken:
        (folder / f"depth/{i}.png").write_bytes(b"no image")
    rgb, depth = str(folder / "rgb"), str(folder / "depth")
    camera = [30.0, 30.0, 15.5, 11.5]
    return OwnFrames(FrameFiles(rgb=rgb, depth=depth, intrinsics=camera, depth_scale=scale))


def test_frames_whose_depth_cannot_be_read_do_not_keep_its_unit_from_the_others(detector, tmp_path):
    own = frames(tmp_path, (0, 1), scale=None)
    assert predict(detector, own, tmp_path / "out", PredictionOptions()) == 1
    broken = frames(tmp_path / "all", (0, 1, 2), scale=None)
    with pytest.raises(DataError, match="none of the 3 frames can be used"):
        predict(detector, broken, tmp_path / "none", PredictionOptions())


@pytest.mark.parametrize("count", [1, 3])
def test_several_frames_are_counted_on_a_terminal_between_the_answers(
    count, detector, tmp_path, terminal
):
    predict(detector, frames(tmp_path, count=count), tmp_path / "out", PredictionOptions())
    said = terminal.readouterr()
    assert said.out.count("\n") == 1 + count
    assert bool(said.err) == (count > 1)
    assert count == 1 or all(words in said.err for words in ("poses: 100%", "3/3", "frame/s"))
    drawn = [path.name for path in (tmp_path / "out").glob("panels/*")]
    assert drawn == (["0.png"] if count == 1 else [])


def test_a_broken_first_frame_keeps_neither_the_header_nor_the_checks_from_the_others(
    detector, tmp_path, monkeypatch, caplog, capsys
):
    checked = list[str]()

    def check(examined, _):
        checked.append(examined.key)
        return [Finding("intrinsics", "here", "the camera is odd", "Mend it")]

    monkeypatch.setattr(known_objects, "check_first_frame", check)
    with caplog.at_level(logging.INFO):
        used = predict(detector, frames(tmp_path, (0,)), tmp_path / "out", PredictionOptions())
    assert used == 2
    assert checked == ["000000_000001"]
    assert "the camera is odd" in caplog.text and "1 of 3 frames could not be used" in caplog.text
    header, *printed = capsys.readouterr().out.splitlines()
    assert header == HEADER and len(printed) == 2 and header not in printed
    assert all(line.endswith("not found: nothing looks like it") for line in printed)
    lines = [json.loads(x) for x in (tmp_path / "out" / "poses.jsonl").read_text().splitlines()]
    assert ["error" in line for line in lines] == [True, False, False]


def test_what_goes_wrong_in_the_checks_is_not_blamed_on_the_frame(detector, tmp_path, monkeypatch):
    def check(*_):
        raise DataError("of the checks")

    monkeypatch.setattr(known_objects, "check_first_frame", check)
    with pytest.raises(DataError, match="of the checks"):
        predict(detector, frames(tmp_path), tmp_path / "out", PredictionOptions())
    assert "error" not in (tmp_path / "out" / "poses.jsonl").read_text()


def test_what_is_learnt_is_damaged_and_no_frame_is_to_blame(detector, tmp_path):
    detector.stopped_at, detector.stop = 1, DamagedError("classifier.onnx is damaged")
    with pytest.raises(DamagedError):
        predict(detector, frames(tmp_path), tmp_path / "out", PredictionOptions())
    assert (tmp_path / "out" / "poses.jsonl").read_text() == ""


def test_a_sequence_of_an_unknown_object_replaces_no_answers(detector, tmp_path):
    def tracker(*_):
        raise InputError("there is no object 'beer'")

    detector.tracker = tracker
    with pytest.raises(InputError):
        predict(detector, frames(tmp_path), tmp_path / "out", PredictionOptions(track=True))
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("count", [1, 2])
def test_without_any_answer_no_header_stands_above_the_error(detector, tmp_path, capsys, count):
    all_broken = frames(tmp_path, tuple(range(count)), count)
    with pytest.raises(DataError):
        predict(detector, all_broken, tmp_path / "out", PredictionOptions())
    assert capsys.readouterr().out == ""


def test_an_error_leaves_no_thread_that_decodes(detector, tmp_path):
    """It would end whenever its generator is collected, where waiting for it may block."""
    before = set(threading.enumerate())
    with pytest.raises(DataError) as kept:
        predict(detector, frames(tmp_path, (0,), 1), tmp_path / "out", PredictionOptions())
    new = {t.name for t in set(threading.enumerate()) - before}
    assert kept and not any("ThreadPool" in name for name in new)


def stop(detector, own, output):
    """Stop a call at its fourth search."""
    detector.searched, detector.stopped_at = 0, 4
    with pytest.raises(KeyboardInterrupt):
        predict(detector, own, output, PredictionOptions())
    detector.searched, detector.stopped_at = 0, -1


def test_a_stopped_call_is_continued_after_its_last_whole_frame(detector, tmp_path, caplog):
    own, output = frames(tmp_path, (1,), 6), tmp_path / "out"
    predict(detector, own, tmp_path / "whole", PredictionOptions())
    stop(detector, own, output)  # frames 0, 2 and 3 are answered, and 1 cannot be used
    with caplog.at_level(logging.INFO):
        assert predict(detector, own, output, PredictionOptions()) == 5
    assert "3 of 6 frames are answered already" in caplog.text
    assert detector.searched == 3  # 3 again, whose answers might not have been complete
    for name in FILES:
        texts = [(folder / name).read_text() for folder in (tmp_path / "whole", output)]
        first, second = (re.sub(r'"seconds": [0-9.e-]+', "", text) for text in texts)
        assert first == second
    assert sorted(path.name for path in output.iterdir()) == [*FILES]


@pytest.mark.parametrize(
    ("changed", "searched"),
    [("nothing", 2), ("max_instances", 4), ("objects", 4), ("image", 4), ("learnt", 4)],
)
def test_another_request_begins_anew(detector, tmp_path, changed, searched):
    own, output = frames(tmp_path, count=4), tmp_path / "out"
    stop(detector, own, output)
    options = {"max_instances": {"max_instances": 1}, "objects": {"objects": ["bear"]}}
    if changed == "image":
        os.utime(tmp_path / "rgb" / "0.png", ns=(1, 1))
    if changed == "learnt":
        (detector.folder / "learnt.json").write_text("{ }")
    predict(detector, own, output, PredictionOptions(**options.get(changed, {})))
    assert detector.searched == searched


@pytest.mark.parametrize(
    ("name", "damage"),
    [
        *(("poses.jsonl", text) for text in (b"", b"{", b"[1]\n", b'{"im_id": 1}\n', b"\xff\xfe")),
        ("poses.jsonl", b'{"scene_id": [1], "im_id": 1}\n{"scene_id": 1, "im_id": 2}\n'),
        ("poses.csv", b"\xff\xfe"),
        ("poses.csv", None),
    ],
)
def test_damaged_answers_of_a_stopped_call_are_made_again(detector, tmp_path, name, damage):
    own, output = frames(tmp_path, count=4), tmp_path / "out"
    stop(detector, own, output)
    (output / name).unlink()
    if damage is not None:
        (output / name).write_bytes(damage)
    assert predict(detector, own, output, PredictionOptions()) == 4
    assert detector.searched == 4
    assert len((output / "poses.jsonl").read_text().splitlines()) == 4


POSE = np.eye(4)
POSE[:3, :3] = Rotation.from_rotvec([10.0, -20.0, 30.0], degrees=True).as_matrix()
POSE[:3, 3] = [0.1, -0.25, 0.7]


def test_a_line_holds_translation_and_rotation_vector_below_the_header():
    line = pose_line("a", "bolt", 0.876, POSE)
    numbers = [float(word) for word in line.split()[2:]]
    assert numbers == [0.88, 100.0, -250.0, 700.0, 10.0, -20.0, 30.0]
    assert line.split()[:2] == ["a", "bolt"]
    assert len(line) == len(HEADER)


def test_a_pose_has_the_keys_of_bop():
    fit = PoseFit(0.1, 0.9, 0.9, 1.0, 1.0)
    found = Detection("bolt", 0.876, POSE, 0.9, 0.1, 1.5, POSE[None], None, fit)
    values = detection_values(found)
    np.testing.assert_array_equal(np.reshape(values.pop("cam_R_m2c"), (3, 3)), POSE[:3, :3])
    assert values == {
        "score": 0.876,
        "cam_t_m2c": [100.0, -250.0, 700.0],
        "visible_fraction": 0.9,
        "residual_mm": 1.5,
    }
    assert detection_values(replace(found, rank=3))["rank"] == 3
