"""A worker's networks are those of the run that sends it frames."""

from functools import partial
from types import SimpleNamespace

import pytest

from fake_detection import KEYS, FakeEstimator, fake_dataset, method_settings
from hlp.errors import MissingFileError
from hlp.stages import detection, frame_task
from hlp.stages.frame_task import Worker, what_makes
from hlp.stages.store import Output

SETTINGS = method_settings()


def task_of(work, classifier):
    """A task of a run whose classifier has this fingerprint; all else is the same."""
    learnt = {("classifier", 0): Output(classifier, work / "classifier" / classifier)}
    worker = Worker(DATA, SETTINGS, work, what_makes(fake_dataset()), learnt)
    return partial(worker.find, {"regions": work}, ("regions",))


DATA = SimpleNamespace(build=fake_dataset)


@pytest.fixture(autouse=True)
def fake(monkeypatch):
    monkeypatch.setattr(detection, "PoseEstimator", FakeEstimator)
    monkeypatch.setattr(frame_task, "_KEPT", SimpleNamespace())


def test_networks_stay_loaded_from_frame_to_frame(tmp_path):
    task_of(tmp_path, "one")(KEYS[0])
    kept = frame_task._KEPT.detection
    task_of(tmp_path, "one")(KEYS[1])
    assert frame_task._KEPT.detection is kept


def test_a_run_that_learnt_otherwise_with_equal_settings_has_its_own_networks(tmp_path):
    """Other photographs or another start make another classifier; the settings are the same."""
    task_of(tmp_path, "one")(KEYS[0])
    kept = frame_task._KEPT.detection
    task_of(tmp_path, "other")(KEYS[0])
    assert frame_task._KEPT.detection is not kept
    assert frame_task._KEPT.detection.training.made["classifier", 0].fingerprint == "other"


def test_a_worker_that_does_not_see_the_work_folder_says_so(tmp_path):
    """As on a machine without the shared disk; otherwise it would write where nobody looks."""
    with pytest.raises(
        MissingFileError, match=r"elsewhere \(work\) is not there for the worker on"
    ):
        task_of(tmp_path / "elsewhere", "one")(KEYS[0])
    assert not list(tmp_path.iterdir())
