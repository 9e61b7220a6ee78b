"""Frames in workers: the same files as one process writes, whatever the engine."""

import dataclasses
import shutil
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
import pytest
import torch
from hydra import compose, initialize_config_dir

import hlp
from hlp.commands.composing import config_folder
from hlp.config.build import Run, build_run
from hlp.errors import DataError
from hlp.method.find.trace import STAGES
from hlp.method.learn.checkpoints import read_history, read_weights
from hlp.runs.run_stages import stages_of
from hlp.stages.detection import DetectionStages
from hlp.stages.frame_task import FrameTask, render_in_workers
from hlp.stages.store import StageStore
from hlp.stages.trace_files import read_arrays
from tiny_run import TinyRun

pytestmark = [pytest.mark.slow, pytest.mark.thorough]


@pytest.fixture(autouse=True)
def threads() -> Iterator[None]:
    """Workers that are threads set the number of threads of torch and OpenCV."""
    number = torch.get_num_threads()
    yield
    torch.set_num_threads(number)
    cv2.setNumThreads(-1)


@pytest.fixture
def work(tiny_run: TinyRun, tmp_path: Path) -> Path:
    """What the tiny run has learnt, and nothing that it has found."""
    for stage in ("views", "classifier", "encoder", "codebook"):
        shutil.copytree(tiny_run.folder / "work" / stage, tmp_path / "work" / stage)
    return tmp_path / "work"


def build(tiny_run: TinyRun, work: Path, *overrides: str) -> Run:
    given = (*tiny_run.overrides, f"work={work}", "output=out", *overrides)
    with initialize_config_dir(str(config_folder()), version_base="1.3"):
        return build_run(compose("config", overrides=list(given)))


def detection_of(run: Run, work: Path) -> DetectionStages:
    return stages_of(run, StageStore(work))


def assert_same_files(detection: DetectionStages, tiny_run: TinyRun) -> None:
    """Every stage has the name that the tiny run's has, and holds the same bits."""
    for output in (detection.regions(), detection.hypotheses(), detection.poses()):
        (expected,) = (tiny_run.folder / "work").glob(f"*/{output.fingerprint}")
        assert output.folder != expected
        for key in detection.keys:
            found, wanted = read_arrays(output.folder, key), read_arrays(expected, key)
            assert found.keys() == wanted.keys()
            for name in found:
                np.testing.assert_array_equal(found[name], wanted[name])


def made(detection: DetectionStages) -> list[str]:
    return [event.stage for event in detection.store.events if not event.reused]


@pytest.mark.parametrize(
    ("executor", "workers", "threads"),
    [
        ("loky", 2, 1),
        ("threading", 2, 1),
        ("loky", 1, 2),
        ("loky", 4, 1),
        ("threading", 1, 2),
    ],
)
def test_workers_of_this_machine_find_the_same_bits(
    tiny_run: TinyRun,
    work: Path,
    executor: str,
    workers: int,
    threads: int,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """However many workers there are, and however many threads each of them has."""
    chosen = (f"executor={executor}", f"executor.workers={workers}", f"executor.threads={threads}")
    detection = detection_of(build(tiny_run, work, *chosen), work)
    monkeypatch.setattr(detection, "find", None)  # the run's own process finds nothing
    detection.poses()
    assert made(detection) == [*STAGES]
    assert_same_files(detection, tiny_run)


def test_a_dask_cluster_of_two_processes_finds_the_same_bits(
    tiny_run: TinyRun, work: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    distributed = pytest.importorskip("distributed", reason="dask is not installed")
    monkeypatch.setenv("PYTHONPATH", str(Path(hlp.__file__).parents[1]))
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None
    ) as cluster:
        address = cluster.scheduler_address
        run = build(tiny_run, work, "executor=dask", f"executor.address={address}")
        detection = detection_of(run, work)
        monkeypatch.setattr(detection, "find", None)
        detection.poses()
        with distributed.Client(address) as client:
            at_work = client.run(eval, "'hlp.stages.frame_task' in __import__('sys').modules")
    assert list(at_work.values()) == [True, True]  # each of the two has had a frame
    assert made(detection) == [*STAGES]
    assert_same_files(detection, tiny_run)


def test_a_worker_of_other_data_finds_nothing(
    tiny_run: TinyRun, work: Path, tmp_path: Path
) -> None:
    detection = detection_of(build(tiny_run, work, "executor=loky"), work)
    right = FrameTask.of(detection, {"regions": tmp_path}, ("regions",))
    wrong = FrameTask(**{**vars(right), "made_from": {**right.made_from, "frames": "others"}})
    with pytest.raises(DataError, match="does not have the same frames as the run"):
        wrong(detection.keys[0])
    assert not list(tmp_path.glob("*.npz"))


def test_two_processes_train_the_classifier(tiny_run: TinyRun, work: Path) -> None:
    """Lightning's DDP on the tiny run's windows: another classifier, as good as one process's."""
    found_by = [
        detection_of(build(tiny_run, work, f"trainer={name}"), work) for name in ("cpu", "ddp")
    ]
    one, two = (detection.training.classifier() for detection in found_by)
    assert made(found_by[0]) == [] and made(found_by[1]) == ["classifier"]
    assert one.fingerprint != two.fingerprint
    (expected,), (found,) = read_history(one.folder), read_history(two.folder)
    assert found["loss"] == pytest.approx(expected["loss"], rel=0.2)
    for value in read_weights(two.folder).values():
        assert torch.isfinite(value.float()).all()


@pytest.mark.parametrize("executor", ["loky", "threading"])
def test_workers_render_missing_views_and_the_same(
    tiny_run: TinyRun, work: Path, executor: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    training = detection_of(build(tiny_run, work, f"executor={executor}"), work).training
    first, second, *_ = sorted(training.dataset.models)
    wanted = {i: training.load_views(i) for i in (first, second)}
    for object_id in wanted:
        shutil.rmtree(training.views(object_id).folder)
    run = build(tiny_run, work, f"executor={executor}")
    training = detection_of(run, work).training
    assert training.missing_views() == [first, second]
    render_in_workers(training, run.settings.executor)
    assert training.missing_views() == []
    events = [(event.stage, event.of, event.reused) for event in training.store.events]
    names = {training.dataset.models[i].name for i in wanted}
    assert sorted(events) == sorted(("views", name, False) for name in names)
    for object_id, views in wanted.items():
        found = training.load_views(object_id)
        for field in dataclasses.fields(views):
            np.testing.assert_array_equal(getattr(found, field.name), getattr(views, field.name))


def test_an_error_in_a_worker_is_the_runs(
    tiny_run: TinyRun, work: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A frame that cannot be searched, in whichever worker."""

    def fail(*_: object) -> None:
        raise FileNotFoundError("the frame has gone")

    detection = detection_of(build(tiny_run, work, "executor=threading"), work)
    monkeypatch.setattr("hlp.stages.detection.search_frame", fail)
    with pytest.raises(FileNotFoundError, match="the frame has gone"):
        detection.regions()
    assert made(detection) == []
