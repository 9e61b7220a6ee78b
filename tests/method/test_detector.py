"""The public API on small learnt objects: detection, and what it refuses."""

import pickle
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
from hlp.data.synthetic.objects import demo_objects
from hlp.errors import InputError
from hlp.evaluation.errors import add_s
from hlp.records import Frame
from hlp.settings import SettingsError

EVERY: dict[str, Any] = {"max_instances": 1, "min_score": 0.0}  # as if the object were there

MODELS = {model.name: model for model in demo_objects().values()}


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


def test_a_roughly_known_pose_is_refined(learnt: Path, frame: Frame) -> None:
    bear, detector = MODELS["bear"], Detector.load(learnt)
    (target,) = [each for each in frame.targets if each.object_id == bear.object_id]
    given = (frame.rgb, frame.depth, frame.camera_matrix)
    rough = target.pose_cam_obj.copy()
    rough[:3, 3] += [0.004, -0.003, 0.01]
    found = detector.refine(*given, "bear", rough)
    assert found is not None and found.object == "bear" and found.seconds > 0.0
    off = [
        add_s(each, target.pose_cam_obj, bear.mesh.vertices) for each in (rough, found.pose_cam_obj)
    ]
    assert off[1] < 0.5 * off[0] and off[1] < 0.05 * bear.diameter
    behind = np.diag([1.0, -1.0, -1.0, 1.0]) @ target.pose_cam_obj
    assert detector.refine(*given, "bear", behind) is None
    with pytest.raises(InputError, match="cat not learnt"):
        detector.refine(*given, "cat", rough)
    with pytest.raises(InputError, match=r"pose_cam_obj must be 4 × 4"):
        detector.refine(*given, "bear", rough[:3])


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
    prepare, clock, late = detector._estimator.prepare, time.perf_counter, [0.0]

    def slowly(*given: Any) -> object:
        late[0] = 1000.0
        return prepare(*given)

    monkeypatch.setattr(detector._estimator, "prepare", slowly)
    monkeypatch.setattr(time, "perf_counter", lambda: clock() + late[0])
    found = detector.detect(frame.rgb, frame.depth, frame.camera_matrix, **EVERY)
    seconds = {each.object: each.seconds for each in found}
    assert seconds["bear"] > 1000.0 > seconds["can"] > 0.0


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
    assert int(done.stdout) < 90  # more modules of HLP make the first answer later


def test_a_detector_is_pickled_as_its_folder(learnt: Path) -> None:
    detector = pickle.loads(pickle.dumps(Detector.load(learnt, threads=1)))
    assert detector.folder == learnt.resolve() and detector.threads == 1
    assert detector.objects == Detector.load(learnt).objects


@pytest.mark.parametrize("threads", [1.5, "2", True, 10**6])
def test_threads_are_a_whole_number(learnt: Path, threads: Any) -> None:
    with pytest.raises(SettingsError, match="threads is"):
        Detector.load(learnt, threads=threads)
