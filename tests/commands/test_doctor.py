"""Faults of data sets, found and named (tests/checks has more of them), and those of a machine."""

import json
import shutil
from importlib.metadata import PackageNotFoundError
from types import SimpleNamespace

import cv2
import numpy as np
import pytest

from frame_files import write_bop_set
from hlp.commands import doctor
from hlp.commands.doctor import check_libraries, check_threads
from hlp.data.own_frames import FrameFiles, OwnFrames
from hlp.data.synthetic.scenes import SyntheticScenes, SyntheticSettings


@pytest.fixture(scope="module")
def healthy(tmp_path_factory):
    """Two demo scenes as frames in BOP's layout."""
    root = tmp_path_factory.mktemp("doctor") / "set"
    scenes = SyntheticScenes(SyntheticSettings(scenes=2, objects=(3, 3), clutter=(2, 3)))
    frames = [scenes.load(key) for key in scenes.keys]
    write_bop_set(root, frames, {t.object_id for frame in frames for t in frame.targets})
    return root


def _truncate(scene):
    path = scene / "depth" / "000001.png"
    path.write_bytes(path.read_bytes()[:3000])


def _open_gl(scene):
    """Frames that `load` refuses: the objects are behind the camera."""
    path = scene / "scene_gt.json"
    content = json.loads(path.read_text())
    for target in (target for entry in content.values() for target in entry):
        turned = np.diag([1.0, -1.0, -1.0]) @ np.reshape(target["cam_R_m2c"], (3, 3))
        target["cam_R_m2c"] = turned.ravel().tolist()
        target["cam_t_m2c"] = (np.array(target["cam_t_m2c"]) * [1, -1, -1]).tolist()
    path.write_text(json.dumps(content))


@pytest.mark.slow
@pytest.mark.parametrize(("plant", "kinds"), [(_truncate, {"files"}), (_open_gl, {"axes"})])
def test_a_fault_in_the_files_of_a_data_set_is_named(healthy, tmp_path, plant, kinds):
    root = shutil.copytree(healthy, tmp_path / "set")
    plant(root / "test" / "000001")
    findings = doctor.examine_dataset(root, None)
    assert {finding.kind for finding in findings} == kinds, [str(finding) for finding in findings]


@pytest.mark.slow
def test_a_healthy_set_has_no_finding_and_is_drawn(healthy, tmp_path):
    assert doctor.examine_dataset(healthy, tmp_path / "look") == []
    pictures = sorted((tmp_path / "look").iterdir())
    assert len(pictures) == 2 and cv2.imread(str(pictures[0])).any()


@pytest.mark.slow
def test_what_is_no_data_set_is_a_finding(tmp_path):
    (finding,) = doctor.examine_dataset(tmp_path, None)
    assert finding.kind == "data set" and "scene_camera.json" in finding.advice
    detector, (finding,) = doctor.examine_learnt(tmp_path)
    assert detector is None and finding.kind == "learnt objects"


@pytest.mark.slow
def test_own_frames_are_examined_without_true_poses(healthy):
    scene = healthy / "test" / "000001"
    given = {"rgb": str(scene / "rgb"), "depth": str(scene / "depth")}
    camera = str(scene / "scene_camera.json")
    assert doctor.examine_own(OwnFrames(FrameFiles(**given, intrinsics=camera)), None) == []
    wrong = FrameFiles(**given, intrinsics=[250.0, 250.0, 160.0, 120.0], depth_scale=0.1)
    (finding,) = doctor.examine_own(OwnFrames(wrong), None)
    assert finding.kind == "intrinsics"
    (finding,) = doctor.examine_own(OwnFrames(FrameFiles(**given, intrinsics="none.json")), None)
    assert "is not a file" in finding.problem


def test_a_missing_library_is_named_with_what_installs_it():
    stated = ["numpy>=2.4,<2.5", "no-such-library>=1.2", "optuna>=5; extra == 'search'"]
    (finding,) = check_libraries(stated)
    assert finding.where == "no-such-library"
    assert finding.advice == "pip install 'no-such-library>=1.2'"
    assert check_libraries() == []


def test_where_only_what_finds_objects_is_installed_the_rest_is_one_finding(monkeypatch):
    def version(name):
        if name in {"torch", "mlflow"}:
            raise PackageNotFoundError(name)

    monkeypatch.setattr("hlp.commands.doctor.version", version)
    (finding,) = check_libraries()
    assert finding.where == "torch" and "pip install torch==" in finding.advice


@pytest.mark.parametrize(
    ("variable", "value", "named"),
    [
        ("OMP_WAIT_POLICY", "active", 1),
        ("OMP_WAIT_POLICY", "PASSIVE", 0),
        ("OMP_NUM_THREADS", "64", 1),
        ("OMP_NUM_THREADS", "4", 0),
        ("MKL_NUM_THREADS", "x", 0),
    ],
)
def test_threads_that_cost_time_are_named(variable, value, named, monkeypatch):
    monkeypatch.setattr("os.cpu_count", lambda: 4)
    monkeypatch.setattr("os.environ", {variable: value})
    assert [finding.where for finding in check_threads()] == [f"{variable}={value.upper()}"] * named


def test_a_machine_with_too_little_disk_is_described(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr("shutil.disk_usage", lambda place: SimpleNamespace(free=1e8))
    monkeypatch.setattr("os.environ", {})
    with pytest.raises(SystemExit):
        doctor.doctor([f"work={tmp_path}/not/yet"])
    machine, optional, finding = capsys.readouterr().out.splitlines()
    assert machine.startswith("machine ") and "optional: " in optional
    assert finding.startswith(f"1. disk: {tmp_path}/not/yet") and "0.1 GB are free" in finding
    monkeypatch.setattr("shutil.disk_usage", lambda place: SimpleNamespace(free=1e12))
    doctor.doctor([f"work={tmp_path}"])
    assert capsys.readouterr().out.splitlines()[-1] == "nothing wrong was found"
