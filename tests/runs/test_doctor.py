"""Faults planted in the files of a data set are found and named; tests/checks has more of them."""

import json
import shutil

import cv2
import numpy as np
import pytest
import trimesh

from hlp.commands import doctor
from hlp.data.own_frames import FrameFiles, OwnFrames
from hlp.data.synthetic.objects import demo_objects
from hlp.data.synthetic.scenes import SyntheticScenes, SyntheticSettings

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def healthy(tmp_path_factory):
    """Two demo scenes in BOP's layout."""
    root = tmp_path_factory.mktemp("doctor") / "set"
    scene = root / "test" / "000001"
    for name in ("rgb", "depth"):
        (scene / name).mkdir(parents=True)
    (root / "models").mkdir()
    scenes = SyntheticScenes(SyntheticSettings(scenes=2, objects=(3, 3), clutter=(2, 3)))
    cameras, truths, shown = {}, {}, set()
    for number, key in enumerate(scenes.keys):
        frame = scenes.load(key)
        cv2.imwrite(str(scene / f"rgb/{number:06d}.png"), frame.rgb[..., ::-1])
        depth = np.rint(frame.depth * 10_000).astype(np.uint16)
        cv2.imwrite(str(scene / f"depth/{number:06d}.png"), depth)
        cameras[number] = {"cam_K": frame.camera_matrix.ravel().tolist(), "depth_scale": 0.1}
        truths[number] = [
            {
                "obj_id": target.object_id,
                "cam_R_m2c": target.pose_cam_obj[:3, :3].ravel().tolist(),
                "cam_t_m2c": (target.pose_cam_obj[:3, 3] * 1000).tolist(),
            }
            for target in frame.targets
        ]
        shown |= {target.object_id for target in frame.targets}
    (scene / "scene_camera.json").write_text(json.dumps(cameras))
    (scene / "scene_gt.json").write_text(json.dumps(truths))
    info = {}
    for object_id in shown:
        mesh = demo_objects()[object_id].mesh
        raw = trimesh.Trimesh(mesh.vertices * 1000, mesh.faces, process=False)
        raw.export(root / "models" / f"obj_{object_id:06d}.ply")
        turn = np.eye(4)
        turn[:2, :2] = [[np.cos(1e-3), -np.sin(1e-3)], [np.sin(1e-3), np.cos(1e-3)]]
        # Any symmetry stated: then none is looked for.
        info[object_id] = {"symmetries_discrete": [turn.ravel().tolist()]}
    (root / "models" / "models_info.json").write_text(json.dumps(info))
    return root


def _edit(path, change):
    content = json.loads(path.read_text())
    for entry in content.values():
        change(entry)
    path.write_text(json.dumps(content))


def _truncate(scene):
    path = scene / "depth" / "000001.png"
    path.write_bytes(path.read_bytes()[:3000])


def _transpose(scene):
    def change(entry):
        for target in entry:
            target["cam_R_m2c"] = np.reshape(target["cam_R_m2c"], (3, 3)).T.ravel().tolist()

    _edit(scene / "scene_gt.json", change)


def _open_gl(scene):
    """Frames that `load` refuses: the objects are behind the camera."""

    def change(entry):
        for target in entry:
            turned = np.diag([1.0, -1.0, -1.0]) @ np.reshape(target["cam_R_m2c"], (3, 3))
            target["cam_R_m2c"] = turned.ravel().tolist()
            target["cam_t_m2c"] = (np.array(target["cam_t_m2c"]) * [1, -1, -1]).tolist()

    _edit(scene / "scene_gt.json", change)


def _scale_depth(scene):
    _edit(scene / "scene_camera.json", lambda entry: entry.update(depth_scale=1.0))


@pytest.mark.parametrize(
    ("plant", "kinds"),
    [
        (_truncate, {"files"}),
        (_transpose, {"rotations"}),
        (_open_gl, {"axes"}),
        (_scale_depth, {"depth scale"}),
    ],
)
def test_a_fault_in_the_files_of_a_data_set_is_named(healthy, tmp_path, plant, kinds):
    root = shutil.copytree(healthy, tmp_path / "set")
    plant(root / "test" / "000001")
    findings = doctor.examine_dataset(root, None)
    assert {finding.kind for finding in findings} == kinds, [str(finding) for finding in findings]


def test_a_healthy_set_has_no_finding_and_is_drawn(healthy, tmp_path):
    assert doctor.examine_dataset(healthy, tmp_path / "look") == []
    pictures = sorted((tmp_path / "look").iterdir())
    assert len(pictures) == 2 and cv2.imread(str(pictures[0])).any()
    assert list(doctor.describe([])) == ["nothing wrong was found"]


def test_what_is_no_data_set_is_a_finding(tmp_path):
    (finding,) = doctor.examine_dataset(tmp_path, None)
    assert finding.kind == "data set" and "scene_camera.json" in finding.advice
    detector, (finding,) = doctor.examine_learnt(tmp_path)
    assert detector is None and finding.kind == "learnt objects"


def test_own_frames_are_examined_without_true_poses(healthy):
    scene = healthy / "test" / "000001"
    given = {"rgb": str(scene / "rgb"), "depth": str(scene / "depth")}
    camera = str(scene / "scene_camera.json")
    assert doctor.examine_own(OwnFrames(FrameFiles(**given, intrinsics=camera)), None) == []
    wrong = FrameFiles(**given, intrinsics=[250.0, 250.0, 160.0, 120.0], depth_scale=0.1)
    (finding,) = doctor.examine_own(OwnFrames(wrong), None)
    assert finding.kind == "intrinsics"
    nothing = FrameFiles(**given, intrinsics="none.json")
    (finding,) = doctor.examine_own(OwnFrames(nothing), None)
    assert "no file" in finding.problem
