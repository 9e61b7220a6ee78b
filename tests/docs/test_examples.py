"""The Python examples of README and the pages run as they stand, on one object in one frame."""

import ast
import shutil
from functools import partial
from pathlib import Path

import pytest
from markdown_pages import EXAMPLES, blocks

from frame_files import write_image
from hlp import Detector
from hlp.data.synthetic.objects import demo_objects
from hlp.data.synthetic.scenes import SyntheticScenes, SyntheticSettings
from hlp.evaluation.errors import add
from tiny_method import LEARNS_WELL, tiny_method, write_mesh

SCENES = {
    **{"scenes": 1, "seed": 3, "width": 640, "height": 480, "noise": 1.0, "min_visible": 0.8},
    **{"objects": (5, 5), "clutter": (2, 2), "distance_mm": (700, 800)},
    **{"elevation_deg": (30, 50), "roll_deg": 10, "tilt_deg": 0},
}


def python_blocks(path: Path):
    return [block for block in blocks(path) if block.language == "python"]


PAGES = [path for path in EXAMPLES if python_blocks(path)]


@pytest.fixture(scope="module")
def own_files(tmp_path_factory):
    """Folder with what the examples read, the frame, and the true pose of its `bracket`."""
    folder = tmp_path_factory.mktemp("examples")
    scenes = SyntheticScenes(SyntheticSettings(**SCENES))
    frame = scenes.load(scenes.keys[0])
    models = demo_objects()
    target = next(t for t in frame.targets if len(models[t.object_id].symmetries) == 1)
    mesh = write_mesh(folder, models[target.object_id])
    for name in ("bracket.ply", "bolt.ply"):
        shutil.copy(mesh, folder / name)
    files = write_image(folder, "0", frame)
    shutil.copy(files["rgb"], folder / "frame.png")
    shutil.copy(files["depth"], folder / "frame_depth.png")
    return folder, frame, models[target.object_id], target.pose_cam_obj


def run_examples(path: Path, names: dict[str, object]) -> None:
    """Blocks of a page share their names, as a reader who types them in would have it."""
    for block in python_blocks(path):
        if not block.not_run:
            place = f"{path.name} from line {block.line}"
            exec(compile("\n" * block.line + block.text, place, "exec"), names)


@pytest.mark.slow
@pytest.mark.parametrize("path", PAGES, ids=lambda path: path.stem)
def test_examples_run_from_first_to_last(path, own_files, monkeypatch):
    """As they stand, but for the settings of learning: with the default ones it takes minutes."""
    folder, frame, model, true_pose = own_files
    monkeypatch.chdir(folder)
    small = partial(Detector.learn, settings=tiny_method(*LEARNS_WELL))
    monkeypatch.setattr(Detector, "learn", small)
    names = {"rgb": frame.rgb, "depth": frame.depth, "camera_matrix": frame.camera_matrix}
    run_examples(path, names)
    if "found" in names:
        # The most certain one: `found` itself is the last one of the loop. The page ends with the
        # `bolt`, which is a copy of the bracket, in the bracket's place.
        best = names["detector"].detect(frame.rgb, frame.depth, frame.camera_matrix)[0]
        error = add(best.pose_cam_obj, true_pose, model.mesh.vertices)
        assert error < 0.1 * model.diameter


@pytest.mark.parametrize("path", PAGES, ids=lambda path: path.stem)
def test_examples_are_python(path):
    for block in python_blocks(path):
        compile(block.text, str(path), "exec")


def test_readme_shows_the_example_that_is_run():
    """README's is not run itself: learning takes a minute."""
    pages = {path.name: path for path in PAGES}
    (shown,) = python_blocks(pages["README.md"])
    run = [block.text for block in python_blocks(pages["own-object.md"]) if not block.not_run]
    assert ast.dump(ast.parse(shown.text)) in [ast.dump(ast.parse(text)) for text in run]
