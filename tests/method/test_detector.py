"""The public API on small learnt objects: detection, and what it refuses."""

import pickle
import shutil
import time
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from hlp import Detector
from hlp.errors import InputError
from hlp.evaluation.errors import add_s
from hlp.settings import SettingsError
from moving_scene import is_right
from new_process import printed_by
from tiny_method import MODELS

EVERY = {"max_instances": 1, "min_score": 0.0}  # as if the object were there


def true_pose(frame, name):
    (target,) = [t for t in frame.targets if t.object_id == MODELS[name].object_id]
    return target.pose_cam_obj


def test_a_learnt_object_is_found_where_it_is(learnt, frame, image):
    (found,) = Detector.load(learnt).detect(*image, objects=["bear"], max_instances=1)
    assert found.object == "bear"
    assert 0.5 <= found.score <= 1.0
    assert 0.0 < found.residual_mm < 20.0
    np.testing.assert_array_equal(found.equivalent_poses[0], found.pose_cam_obj)
    assert found.runner_up is None or 0.0 <= found.runner_up.score <= 1.0
    assert 0.0 <= found.visible_fraction <= 1.0
    assert found.seconds > 0.0
    assert is_right(found.pose_cam_obj, true_pose(frame, "bear"), MODELS["bear"])


def test_what_is_not_good_enough_is_rejected_with_the_reason(learnt, image):
    detector, (rgb, depth, camera_matrix) = Detector.load(learnt), image
    result = detector.search(*image, max_instances=1, min_score=1.0)
    assert [detection.score for detection in result.detections] == [1.0] * len(result.detections)
    assert {item.object for item in result.rejections} == {"bear", "can"}
    for item in result.rejections:
        assert item.answer is not None and item.answer.score < 1.0
        assert item.reason == f"the score {item.answer.score:.2f} of the best pose is below 1"
    nothing = detector.search(rgb, np.zeros_like(depth), camera_matrix)
    assert nothing.detections == [] and len(nothing.rejections) == 2
    for item in nothing.rejections:
        assert item.answer is None and "has depth" in item.reason


def test_a_roughly_known_pose_is_refined(learnt, frame, image):
    bear, true, detector = MODELS["bear"], true_pose(frame, "bear"), Detector.load(learnt)
    rough = true.copy()
    rough[:3, 3] += [0.004, -0.003, 0.01]
    found = detector.refine(*image, "bear", rough)
    assert found is not None and found.object == "bear" and found.seconds > 0.0
    before, after = (add_s(pose, true, bear.mesh.vertices) for pose in (rough, found.pose_cam_obj))
    assert after < 0.5 * before and after < 0.05 * bear.diameter
    assert detector.refine(*image, "bear", np.diag([1.0, -1.0, -1.0, 1.0]) @ true) is None  # behind


def test_the_same_image_gives_the_same_poses(learnt, image, tmp_path):
    """In another folder, in any order, with other threads, and from threads at the same time."""
    expected = {item.object: item for item in Detector.load(learnt).detect(*image, **EVERY)}
    assert expected
    copied = Detector.load(shutil.copytree(learnt, tmp_path / "copied"), threads=1)
    for name in ("can", "bear"):
        for item in copied.detect(*image, objects=[name], **EVERY):
            np.testing.assert_array_equal(item.pose_cam_obj, expected[name].pose_cam_obj)
            assert item.score == expected[name].score
    shared = Detector.load(learnt)
    with ThreadPoolExecutor(2) as pool:
        found = list(pool.map(lambda _: shared.detect(*image, **EVERY), "ab"))
    for one in (one for detections in found for one in detections):
        np.testing.assert_array_equal(one.pose_cam_obj, expected[one.object].pose_cam_obj)


def test_the_shared_part_of_an_image_counts_for_the_first_object(learnt, image, monkeypatch):
    detector = Detector.load(learnt)
    detector.warm_up()
    prepare, clock, late = detector._estimator.prepare, time.perf_counter, [0.0]

    def slowly(*given):
        late[0] = 1000.0
        return prepare(*given)

    monkeypatch.setattr(detector._estimator, "prepare", slowly)
    monkeypatch.setattr(time, "perf_counter", lambda: clock() + late[0])
    found = detector.detect(*image, **EVERY)
    seconds = {item.object: item.seconds for item in found}
    assert seconds["bear"] > 1000.0 > seconds["can"] > 0.0


def test_objects_may_be_named_by_any_iterable(learnt, image):
    detector = Detector.load(learnt)
    (found,) = detector.detect(*image, objects=(name for name in ["bear"]), **EVERY)
    assert found.object == "bear"
    assert detector.detect(*image, objects=[]) == []
    for wrong in ({"objects": ["cat"]}, {"max_instances": 0}, {"min_score": 2}):
        with pytest.raises(InputError, match=next(iter(wrong))):
            detector.detect(*image, **wrong)
    with pytest.raises(InputError, match="rgb is uint8"):
        detector.detect(image[0][..., 0], *image[1:])


HEAVY = (
    *("torch", "pytorch_lightning", "mlflow", "hydra", "omegaconf", "matplotlib", "trimesh"),
    *("pydantic", "scipy.linalg"),
)


def test_detection_imports_no_framework(learnt, image, tmp_path):
    """In a fresh process, from loading to the first pose; nor what only some systems have."""
    np.savez(tmp_path / "image.npz", *image)
    code = (
        "import sys, numpy as np\n"
        "sys.modules['fcntl'] = None\n"
        "from hlp import Detector\n"
        f"image = np.load({str(tmp_path / 'image.npz')!r})\n"
        f"detector = Detector.load({str(learnt)!r})\n"
        "detector.detect(*image.values())\n"
        f"loaded = [name for name in {HEAVY!r} if name in sys.modules]\n"
        "assert not loaded, loaded\n"
        "print(sum(name.partition('.')[0] == 'hlp' for name in sys.modules))\n"
        "import hlp.commands.folders\n"
    )
    assert int(printed_by(code)) < 90  # more modules of HLP make the first answer later


def test_a_detector_is_pickled_as_its_folder_and_finds_it_from_anywhere(
    learnt, image, tmp_path, monkeypatch
):
    monkeypatch.chdir(learnt.parent)
    detector = pickle.loads(pickle.dumps(Detector.load(f"{learnt.name}/", threads=1)))
    monkeypatch.chdir(tmp_path)
    assert detector.folder == learnt.resolve() and detector.threads == 1
    assert detector.objects == Detector.load(learnt).objects
    assert detector.detect(*image, objects=["bear"])


@pytest.mark.parametrize("threads", [1.5, "2", True, 10**6])
def test_threads_are_a_whole_number(learnt, threads):
    with pytest.raises(SettingsError, match="threads is"):
        Detector.load(learnt, threads=threads)
