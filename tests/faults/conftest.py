"""The run that the tests of this folder disturb: smaller still than that of all other tests."""

import json
import os

import pytest

from frame_files import write_image
from hlp.data.synthetic.objects import demo_objects
from hlp.data.synthetic.scenes import SyntheticScenes, SyntheticSettings
from tiny_method import write_mesh
from tiny_run import TINY, make_tiny_run

os.environ.setdefault("MLFLOW_DISABLE_TELEMETRY", "true")  # it is imported before HLP could say so

SCENES = SyntheticSettings(scenes=2, width=320, height=240, objects=(5, 5), clutter=(1, 3))
OBJECTS = 2


@pytest.fixture(scope="session")
def scenes():
    """The frames of all tests here."""
    return SyntheticScenes(SCENES)


@pytest.fixture(scope="session")
def tiny_run(tmp_path_factory, scenes):
    """A run of two objects in two frames, which are files."""

    def overrides(folder):
        if not (folder / "set").is_dir():
            write_set(folder / "set", scenes)
        settings = (setting for setting in TINY if not setting.startswith("data."))
        return ("data=bop", f"data.root={folder / 'set'}", *settings)

    return make_tiny_run(tmp_path_factory, "faults", overrides)


def write_set(root, scenes):
    """Two of the demo's scenes in BOP's layout, with two of its objects annotated."""
    frames = [scenes.load(key) for key in scenes.keys]
    both = set.intersection(*({t.object_id for t in frame.targets} for frame in frames))
    chosen = sorted(both)[:OBJECTS]
    assert len(chosen) == OBJECTS
    (root / "models").mkdir(parents=True)
    for object_id in chosen:
        mesh = write_mesh(root / "models", demo_objects()[object_id])
        mesh.rename(mesh.with_name(f"obj_{object_id:06d}.ply"))
    for number, frame in enumerate(frames):
        _write_scene(root / "test" / f"{number:06d}", frame, chosen)


def _write_scene(folder, frame, chosen):
    write_image(folder, "000000", frame)
    targets = [target for target in frame.targets if target.object_id in chosen]
    truth = [
        {
            "obj_id": target.object_id,
            "cam_R_m2c": target.pose_cam_obj[:3, :3].ravel().tolist(),
            "cam_t_m2c": (target.pose_cam_obj[:3, 3] * 1000.0).tolist(),
        }
        for target in targets
    ]
    camera = {"cam_K": frame.camera_matrix.ravel().tolist(), "depth_scale": 1.0}
    info = [{"visib_fract": float(target.visible_fraction)} for target in targets]
    for name, content in (("camera", camera), ("gt", truth), ("gt_info", info)):
        (folder / f"scene_{name}.json").write_text(json.dumps({"0": content}))
