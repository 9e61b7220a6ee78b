"""Makes the example in src/hlp/example: one of the demo's objects, learnt small, and a frame.

    make example

The frame is a rendered scene in BOP's layout, with the object's true pose. As few views, patches
and channels are learnt as find the object there, so that all is no larger than a picture or two.
Make it again when `learnt.json` has another format; tests/integration/test_example.py says so.
"""

import shutil
import tempfile
from pathlib import Path

import cv2
import numpy as np
import trimesh

from hlp.commands.learn import learn
from hlp.data.synthetic.objects import demo_objects
from hlp.data.synthetic.scenes import SyntheticScenes, SyntheticSettings
from hlp.files import write_json
from hlp.objects.meshes import decimate
from hlp.records import Frame, ObjectModel

FOLDER = Path(__file__).parents[1] / "src" / "hlp" / "example"
OBJECT, FACES = "drill", 3000
SMALL = (
    "rendering.coverage=hemisphere",  # the objects stand on a table
    "rendering.viewpoints=160",
    "rendering.in_plane_min_deg=-30",
    "rendering.in_plane_max_deg=30",
    "rendering.in_plane_steps=6",
    "patches.entries.patches_per_view=4",  # 3840 entries: searched exactly, without lists
    "encoder.dimension=100",
    "encoder.widths=[16,32,48,64]",
    "classifier.widths=[8,16,32,64]",
    "classifier.hidden=32",
)


def main() -> None:
    """Render, learn, and say how large it is."""
    shutil.rmtree(FOLDER, ignore_errors=True)
    model = next(each for each in demo_objects().values() if each.name == OBJECT)
    settings = SyntheticSettings(
        scenes=1, objects=(6, 8), clutter=(4, 8), distance_mm=(600.0, 800.0)
    )
    scenes = SyntheticScenes(settings)
    write_frame(scenes.load(scenes.keys[0]), model)
    with tempfile.TemporaryDirectory() as folder:
        mesh, path = decimate(model.mesh, FACES), Path(folder, f"{OBJECT}.ply")
        trimesh.Trimesh(mesh.vertices, mesh.faces, vertex_colors=mesh.colors, process=False).export(
            path
        )
        learn([f"mesh={path}", "mesh_scale=1", f"output={FOLDER / 'learnt'}", *SMALL])
    sizes = {path: path.stat().st_size for path in FOLDER.rglob("*") if path.is_file()}
    for path, size in sizes.items():
        print(f"{size / 1e6:6.2f} MB  {path.relative_to(FOLDER)}")
    print(f"{sum(sizes.values()) / 1e6:6.2f} MB")


def write_frame(frame: Frame, model: ObjectModel) -> None:
    """The images and the object's pose as a scene in BOP's layout."""
    pose = next(each.pose_cam_obj for each in frame.targets if each.object_id == model.object_id)
    place = FOLDER / "frames"
    for part in ("rgb", "depth"):
        (place / part).mkdir(parents=True)
    quality = [cv2.IMWRITE_JPEG_QUALITY, 92]
    cv2.imwrite(str(place / "rgb" / "000000.jpg"), frame.rgb[..., ::-1], quality)
    millimetres = np.rint(1000 * frame.depth).astype(np.uint16)
    cv2.imwrite(str(place / "depth" / "000000.png"), millimetres)
    camera = {"cam_K": frame.camera_matrix.ravel().tolist(), "depth_scale": 1.0}
    write_json(place / "scene_camera.json", {"0": camera})
    rotation, shift = pose[:3, :3].ravel().tolist(), (1000 * pose[:3, 3]).tolist()
    truth = {"obj_id": 1, "cam_R_m2c": rotation, "cam_t_m2c": shift}
    write_json(place / "scene_gt.json", {"0": [truth]})


if __name__ == "__main__":
    main()
