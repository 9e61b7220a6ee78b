"""The public API on a small object: learn, load, detect, add, remove, and what it refuses."""

import dataclasses
import json
import re
import shutil
import subprocess
import sys
import threading
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hlp import Detector
from hlp.checksums import sealed
from hlp.data.synthetic.objects import demo_objects
from hlp.data.synthetic.scenes import SyntheticScenes, SyntheticSettings
from hlp.errors import ConfigError, DataError, InputError, MissingFileError
from hlp.evaluation.errors import add_s
from hlp.method.learnt_folder import RECORD, read_model
from hlp.records import Frame
from hlp.refinement.score_model import PRIOR
from tiny_method import tiny_method, write_mesh

EVERY: dict[str, Any] = {"max_instances": 1, "min_score": 0.0}  # as if the object were there
MODELS = {model.name: model for model in demo_objects().values()}


@pytest.fixture(scope="module")
def frame() -> Frame:
    """A demo scene that shows the bear clearly."""
    scenes = SyntheticScenes(dataclasses.replace(DEMO, scenes=12, width=320, height=240))
    frames = [scenes.load(key) for key in scenes.keys]
    bear = MODELS["bear"].object_id
    return max(frames, key=lambda each: visible(each, bear))


DEMO = SyntheticSettings(
    scenes=12,
    seed=0,
    width=320,
    height=240,
    noise=0.5,
    min_visible=0.3,
    objects=(5, 5),
    clutter=(1, 3),
    distance_mm=(600.0, 800.0),
    elevation_deg=(20.0, 75.0),
    roll_deg=20.0,
    tilt_deg=5.0,
)


def visible(frame: Frame, object_id: int) -> float:
    return max((t.visible_fraction for t in frame.targets if t.object_id == object_id), default=0.0)


def test_a_learnt_object_is_found_where_it_is(learnt: Path, frame: Frame) -> None:
    bear = MODELS["bear"]
    (target,) = [each for each in frame.targets if each.object_id == bear.object_id]
    (found,) = Detector.load(learnt).detect(
        frame.rgb, frame.depth, frame.camera_matrix, objects=["bear"], max_instances=1
    )
    assert found.object == "bear"
    assert 0.5 <= found.score <= 1.0
    assert 0.0 < found.residual_mm < 20.0
    np.testing.assert_array_equal(found.equivalent_poses[0], found.pose_cam_obj)
    assert found.runner_up is None or 0.0 <= found.runner_up.score <= 1.0
    assert 0.0 <= found.visible_fraction <= 1.0
    assert found.seconds > 0.0
    assert add_s(found.pose_cam_obj, target.pose_cam_obj, bear.mesh.vertices) < 0.1 * bear.diameter


def test_what_is_not_good_enough_is_rejected_with_the_reason(learnt: Path, frame: Frame) -> None:
    detector, given = Detector.load(learnt), (frame.rgb, frame.depth, frame.camera_matrix)
    result = detector.search(*given, max_instances=1, min_score=1.0)
    assert [each.score for each in result.detections] == [1.0] * len(result.detections)
    assert {each.object for each in result.rejections} == {"bear", "can"}
    for each in result.rejections:
        assert each.answer is not None and each.answer.score < 1.0
        assert each.reason == f"the score {each.answer.score:.2f} of the best pose is below 1"
    nothing = detector.search(frame.rgb, np.zeros_like(frame.depth), frame.camera_matrix)
    assert nothing.detections == []
    assert all(each.answer is None and "has depth" in each.reason for each in nothing.rejections)
    assert len(nothing.rejections) == 2
    for wrong, name in (({"max_instances": 0}, "max_instances"), ({"min_score": 2}, "min_score")):
        with pytest.raises(InputError, match=f"{name} is"):
            detector.detect(*given, **wrong)


def test_the_same_image_gives_the_same_poses(learnt: Path, frame: Frame, tmp_path: Path) -> None:
    """In another folder, in any order, with other threads, and from threads at the same time."""
    given = (frame.rgb, frame.depth, frame.camera_matrix)
    expected = {each.object: each for each in Detector.load(learnt).detect(*given, **EVERY)}
    assert expected
    copied = Detector.load(shutil.copytree(learnt, tmp_path / "copied"), threads=1)
    for name in ("can", "bear"):
        for each in copied.detect(*given, objects=[name], **EVERY):
            np.testing.assert_array_equal(each.pose_cam_obj, expected[name].pose_cam_obj)
            assert each.score == expected[name].score
    found: list[list] = []
    shared = Detector.load(learnt)
    threads = [
        threading.Thread(target=lambda: found.append(shared.detect(*given, **EVERY))) for _ in "abc"
    ]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(found) == 3
    for each in (one for detections in found for one in detections):
        np.testing.assert_array_equal(each.pose_cam_obj, expected[each.object].pose_cam_obj)


@pytest.mark.slow
def test_objects_are_added_and_removed(learnt: Path, frame: Frame, tmp_path: Path) -> None:
    folder = shutil.copytree(learnt, tmp_path / "learnt")
    detector = Detector.load(folder)
    before = read_model(folder / "objects" / "bear")
    detector.add({"duck": write_mesh(tmp_path, MODELS["duck"])})
    assert detector.objects == ("bear", "can", "duck")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["duck.ply", "learnt"]
    np.testing.assert_array_equal(
        read_model(folder / "objects" / "bear").mesh.vertices, before.mesh.vertices
    )
    with pytest.raises(InputError, match="knows an object 'duck' already"):
        detector.add({"duck": write_mesh(tmp_path, MODELS["duck"])})
    detector.remove("can")
    assert detector.objects == ("bear", "duck") == Detector.load(folder).objects
    assert not (folder / "objects" / "can").exists()
    found = detector.detect(frame.rgb, frame.depth, frame.camera_matrix)
    assert {each.object for each in found} <= {"bear", "duck"}
    # A class that nobody asks for any more keeps its place, and a new object gets a new one.
    assert json.loads((folder / RECORD).read_text())["classes"] == [1, 2, 3]
    detector.add({"lamp": write_mesh(tmp_path, MODELS["lamp"])})
    assert json.loads((folder / RECORD).read_text())["classes"] == [1, 3, 4]
    detector.remove("duck")
    detector.remove("lamp")
    with pytest.raises(InputError, match="'bear' is the last object"):
        detector.remove("bear")
    with pytest.raises(InputError, match="no object 'cat'; it knows bear"):
        detector.remove("cat")


def test_an_interrupted_call_goes_on_where_it_stopped(
    learnt: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from hlp.method import learning

    meshes = {name: write_mesh(tmp_path, MODELS[name]) for name in ("bear", "can")}
    whole = learning.build_codebook
    monkeypatch.setattr(learning, "build_codebook", lambda *_: 1 / 0)
    with pytest.raises(ZeroDivisionError):
        Detector.learn(meshes, tmp_path / "learnt", settings=tiny_method())
    assert not (tmp_path / "learnt").exists()
    monkeypatch.setattr(learning, "build_codebook", whole)
    monkeypatch.setattr(learning, "train_classifier", lambda *_: 1 / 0)  # done already
    Detector.learn(meshes, tmp_path / "learnt", settings=tiny_method())
    names = sorted(str(p.relative_to(learnt)) for p in learnt.rglob("*") if p.is_file())
    again = tmp_path / "learnt"
    assert names == sorted(str(p.relative_to(again)) for p in again.rglob("*") if p.is_file())
    one, two = (np.load(each / "objects/bear/codebook.npz") for each in (learnt, again))
    for name in one.files:
        np.testing.assert_array_equal(one[name], two[name])


def test_an_interrupted_call_with_other_backgrounds_starts_anew(
    frame: Frame, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from hlp.method import learning

    meshes = {"bear": write_mesh(tmp_path, MODELS["bear"])}
    trained = []
    monkeypatch.setattr(learning, "train_classifier", lambda *given: trained.append(given[2]))
    monkeypatch.setattr(learning, "train_encoder", lambda *_: 1 / 0)
    for frames in ((), (), (frame,)):
        with pytest.raises(ZeroDivisionError):
            Detector.learn(
                meshes, tmp_path / "learnt", settings=tiny_method(), background_frames=frames
            )
    assert [each.frames for each in trained] == [(), (frame,)]


def test_an_encoder_without_the_frames_it_needs_fails_before_anything_is_trained(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from hlp.method import learning

    monkeypatch.setattr(learning, "train_classifier", lambda *_: 1 / 0)
    meshes = {"bear": write_mesh(tmp_path, MODELS["bear"])}
    with pytest.raises(ConfigError, match="encoder=cae trains on RGB-D frames"):
        Detector.learn(meshes, tmp_path / "learnt", settings=tiny_method("encoder=cae"))
    assert not (tmp_path / "learnt.partial").exists()


def test_objects_are_added_by_way_of_any_path_beside_any_folder(
    learnt: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A link stays one, `.` has no name, and a copy that the user made is not touched."""
    from hlp.method import learning

    def train(*given: object) -> None:
        shutil.copytree(learnt / "classifier", Path(str(given[4])), dirs_exist_ok=True)

    monkeypatch.setattr(learning, "train_classifier", train)
    # The copied classifier does not know the new objects.
    monkeypatch.setattr(learning, "calibrate_score", lambda *_: PRIOR)
    folder = shutil.copytree(learnt, tmp_path / "learnt")
    kept = shutil.copytree(learnt, tmp_path / "learnt.old")
    (tmp_path / "link").symlink_to(folder)
    Detector.load(tmp_path / "link").add({"duck": write_mesh(tmp_path, MODELS["duck"])})
    assert (tmp_path / "link").is_symlink() and not folder.is_symlink()
    monkeypatch.chdir(folder)
    detector = Detector.load(".")
    detector.add({"lamp": write_mesh(tmp_path, MODELS["lamp"])})
    assert detector.objects == ("bear", "can", "duck", "lamp") == Detector.load(folder).objects
    assert Detector.load(kept).objects == ("bear", "can")
    names = {path.name for path in tmp_path.iterdir()}
    assert names == {"learnt", "learnt.old", "link", "duck.ply", "lamp.ply"}


def test_files_are_found_after_a_change_of_the_working_directory(
    learnt: Path, frame: Frame, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(learnt.parent)
    detector = Detector.load(f"{learnt.name}/")
    monkeypatch.chdir(tmp_path)
    assert detector.detect(frame.rgb, frame.depth, frame.camera_matrix, objects=["bear"])


def test_the_shared_part_of_an_image_counts_for_the_first_object(
    learnt: Path, frame: Frame, monkeypatch: pytest.MonkeyPatch
) -> None:
    detector = Detector.load(learnt)
    detector.warm_up()
    prepare = detector._estimator.prepare

    def slowly(*given: Any) -> object:
        time.sleep(2.0)
        return prepare(*given)

    monkeypatch.setattr(detector._estimator, "prepare", slowly)
    found = detector.detect(frame.rgb, frame.depth, frame.camera_matrix, **EVERY)
    seconds = {each.object: each.seconds for each in found}
    assert seconds["bear"] > 2.0 > seconds["can"]


def test_a_folder_holds_nothing_that_runs_code(learnt: Path) -> None:
    kinds = {path.suffix for path in learnt.rglob("*") if path.is_file()}
    assert kinds <= {".json", ".npz", ".safetensors", ".onnx", ".csv"}, kinds


def test_wrong_images_are_refused_by_name(learnt: Path, frame: Frame) -> None:
    detector = Detector.load(learnt)
    rgb, depth, camera = frame.rgb, frame.depth, frame.camera_matrix
    moved = camera + np.array([[0, 0, 1000.0], [0, 0, 0], [0, 0, 0]])
    for given, message in (
        ((rgb[..., 0], depth, camera), "rgb is uint8 .* must be uint8"),
        ((rgb / 255.0, depth, camera), "rgb is float64"),
        ((rgb, (depth * 1000).astype(np.uint16), camera), "depth is uint16 .*in metres"),
        ((rgb, depth * 1000, camera), "is it in mm"),
        ((rgb, depth[:-1], camera), "they must be alike"),
        ((rgb, -depth, camera), "negative"),
        ((rgb, depth, camera.T), "its rows must be fx 0 cx"),
        ((rgb, depth, camera[:2]), "3 × 3"),
        ((rgb, depth, moved), "outside the image"),
        ((rgb, depth, camera * np.array([[-1], [1], [1]])), "focal lengths"),
    ):
        with pytest.raises(InputError, match=message):
            detector.detect(*given)
    with pytest.raises(InputError, match="cat not learnt"):
        detector.detect(rgb, depth, camera, objects=["cat"])
    with pytest.raises(InputError, match="give a list"):
        detector.detect(rgb, depth, camera, objects="bear")
    with pytest.raises(InputError, match="objects: 1 not learnt"):
        detector.detect(rgb, depth, camera, objects=[1])
    with pytest.raises(InputError, match="3 × 3 numbers, not 'K'"):
        detector.detect(rgb, depth, "K")


def test_objects_may_be_named_by_any_iterable(learnt: Path, frame: Frame) -> None:
    detector, given = Detector.load(learnt), (frame.rgb, frame.depth, frame.camera_matrix)
    (found,) = detector.detect(*given, objects=(name for name in ["bear"]), **EVERY)
    assert found.object == "bear"
    assert detector.detect(*given, objects=[]) == []


def test_missing_depth_may_be_nan(learnt: Path, frame: Frame) -> None:
    holes = np.where(frame.depth > 0, frame.depth, np.nan)
    given = frame.rgb, frame.camera_matrix
    detector = Detector.load(learnt)
    one = detector.detect(given[0], frame.depth, given[1])
    two = detector.detect(given[0], holes, given[1])
    assert [(each.object, each.score) for each in one] == [(e.object, e.score) for e in two]
    nothing = np.zeros_like(frame.depth)
    assert detector.detect(given[0], nothing, given[1]) == []


def test_wrong_folders_are_refused_by_name(learnt: Path, tmp_path: Path) -> None:
    with pytest.raises(MissingFileError, match="no learnt objects"):
        Detector.load(tmp_path)
    mesh = write_mesh(tmp_path, MODELS["bear"])
    with pytest.raises(InputError, match="holds learnt objects already"):
        Detector.learn({"bear": mesh}, learnt, settings=tiny_method())
    with pytest.raises(InputError, match=r"object name '\.\./bear'"):
        Detector.learn({"../bear": mesh}, tmp_path / "new", settings=tiny_method())
    with pytest.raises(InputError, match="'bear' and 'Bear' differ only in case"):
        Detector.learn({"bear": mesh, "Bear": mesh}, tmp_path / "new", settings=tiny_method())
    with pytest.raises(InputError, match="'bear' and 'Bear' differ only in case"):
        Detector.load(learnt).add({"Bear": mesh})
    folder = shutil.copytree(learnt, tmp_path / "damaged")
    record = json.loads((folder / RECORD).read_text())
    del record["checksum"]
    (folder / RECORD).write_text(json.dumps(sealed({**record, "format": 99})))
    with pytest.raises(DataError, match=r"learnt.json: format is 99"):
        Detector.load(folder)
    (folder / RECORD).write_text("{")
    with pytest.raises(DataError, match="is no JSON"):
        Detector.load(folder)


@pytest.mark.parametrize(
    "file",
    [
        "objects/bear/codebook.npz",
        "objects/bear/model.npz",
        "objects/bear/object.json",
        "classifier/classifier.int8.onnx",
        "encoder/pca.npz",
    ],
)
def test_damaged_and_missing_files_are_named(
    learnt: Path, frame: Frame, tmp_path: Path, file: str
) -> None:
    given = frame.rgb, frame.depth, frame.camera_matrix
    path = shutil.copytree(learnt, tmp_path / "learnt") / file
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    with pytest.raises(DataError, match=re.escape(path.name)):
        Detector.load(tmp_path / "learnt").detect(*given)
    path.unlink()
    with pytest.raises(MissingFileError, match=re.escape(path.name)):
        Detector.load(tmp_path / "learnt").detect(*given)


def flip_a_byte(path: Path) -> None:
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 1
    path.write_bytes(content)


FILES = (
    "learnt.json",
    "classifier/classifier.int8.onnx",
    "encoder/pca.npz",
    "objects/bear/codebook.npz",
    "objects/bear/model.npz",
    "objects/bear/object.json",
    "objects/bear/score.json",
)


@pytest.mark.parametrize("file", FILES)
def test_a_flipped_byte_is_found_before_anything_is_detected(
    learnt: Path, frame: Frame, tmp_path: Path, file: str
) -> None:
    folder = shutil.copytree(learnt, tmp_path / "learnt")
    flip_a_byte(folder / file)
    with pytest.raises(DataError, match=rf"{re.escape(file)} is .*: learn the objects again"):
        Detector.load(folder).detect(frame.rgb, frame.depth, frame.camera_matrix)


@pytest.mark.parametrize("file", ["learnt.json", "classifier/weights.safetensors"])
def test_learning_into_a_damaged_folder_makes_it_again(
    learnt: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, file: str
) -> None:
    """The damaged one is kept; nothing is added to it."""
    from hlp.method import learning

    folder = shutil.copytree(learnt, tmp_path / "learnt")
    flip_a_byte(folder / file)
    with pytest.raises(DataError, match=re.escape(file)):
        Detector.load(folder).add({"duck": write_mesh(tmp_path, MODELS["duck"])})
    meshes = {name: write_mesh(tmp_path, MODELS[name]) for name in ("bear", "can")}
    monkeypatch.setattr(learning, "train_classifier", lambda *_: 1 / 0)
    for _ in range(2):
        with pytest.raises(ZeroDivisionError):
            Detector.learn(meshes, folder, settings=tiny_method())
    assert {path.name for path in tmp_path.iterdir() if path.is_dir()} == {
        "learnt.damaged",
        "learnt.partial",
    }


@pytest.mark.parametrize("name", ["../../secret", "/etc", ".", "a/b"])
def test_a_folder_names_no_file_outside_of_it(learnt: Path, tmp_path: Path, name: str) -> None:
    folder = shutil.copytree(learnt, tmp_path / "learnt")
    record = json.loads((folder / RECORD).read_text())
    del record["checksum"]
    for changed in ({"objects": {name: 1}}, {"files": {f"classifier/../../{name}": "0"}}):
        (folder / RECORD).write_text(json.dumps(sealed(record | changed)))
        with pytest.raises(DataError, match=r"cannot name an object|names a file outside"):
            Detector.load(folder).warm_up()


def test_a_plug_in_that_is_not_installed_is_no_damage(learnt: Path, tmp_path: Path) -> None:
    folder = shutil.copytree(learnt, tmp_path / "learnt")
    record = json.loads((folder / RECORD).read_text())
    record["settings"]["encoder"]["name"] = "cells"
    del record["checksum"]
    (folder / RECORD).write_text(json.dumps(sealed(record)))
    with pytest.raises(DataError, match=r"learnt.json: .*encoder.name is 'cells': choose one of"):
        Detector.load(folder)


HEAVY = ("torch", "pytorch_lightning", "mlflow", "hydra", "omegaconf", "matplotlib", "trimesh")


def test_detection_imports_no_framework(learnt: Path, frame: Frame, tmp_path: Path) -> None:
    """In a fresh process, from loading to the first pose."""
    np.savez(tmp_path / "frame.npz", rgb=frame.rgb, depth=frame.depth, camera=frame.camera_matrix)
    code = (
        "import sys, numpy as np\n"
        "from hlp import Detector\n"
        f"frame = np.load({str(tmp_path / 'frame.npz')!r})\n"
        f"detector = Detector.load({str(learnt)!r})\n"
        "detector.detect(frame['rgb'], frame['depth'], frame['camera'])\n"
        f"loaded = [name for name in {HEAVY!r} if name in sys.modules]\n"
        "assert not loaded, loaded\n"
        "print(sum(name.partition('.')[0] == 'hlp' for name in sys.modules))\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert int(done.stdout) < 78  # what importing the detector took before it had this API


def test_two_processes_do_not_learn_into_one_folder(tmp_path: Path) -> None:
    mesh = write_mesh(tmp_path, MODELS["bear"])
    fcntl = pytest.importorskip("fcntl")
    with (tmp_path / ".learnt.lock").open("w") as stream:
        fcntl.flock(stream, fcntl.LOCK_EX)
        with pytest.raises(InputError, match="another process is learning into learnt"):
            Detector.learn({"bear": mesh}, tmp_path / "learnt", settings=tiny_method())
    (tmp_path / "own.partial").mkdir()
    (tmp_path / "own.partial" / "thesis.txt").write_text("two years of work")
    with pytest.raises(InputError, match=r"own\.partial is in the way"):
        Detector.learn({"bear": mesh}, tmp_path / "own", settings=tiny_method())
    assert (tmp_path / "own.partial" / "thesis.txt").exists()
