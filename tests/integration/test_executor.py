"""Frames in workers: the same files as one process writes, whatever the engine."""

import dataclasses
import json
import os
import shutil
import subprocess
import sys
import time
from contextlib import contextmanager
from functools import partial
from pathlib import Path

import numpy as np
import pytest
import torch

import hlp
from hlp.errors import DataError
from hlp.method.find.trace import STAGES
from hlp.method.learn.model_files import read_history, read_weights
from hlp.runs.runner import stages_of
from hlp.stages.frame_task import Worker, render_in_workers
from hlp.stages.store import StageStore
from hlp.stages.trace_files import read_arrays

pytestmark = [pytest.mark.slow, pytest.mark.thorough, pytest.mark.usefixtures("threads")]


@pytest.fixture
def work(tiny_run, tmp_path):
    """What the tiny run has learnt, and nothing that it has found."""
    for stage in ("views", "classifier", "encoder", "codebook"):
        shutil.copytree(tiny_run.folder / "work" / stage, tmp_path / "work" / stage)
    return tmp_path / "work"


def detection_of(tiny_run, work, *overrides):
    return stages_of(tiny_run.build(f"work={work}", *overrides), StageStore(work))


def find_in_workers(detection, tiny_run, monkeypatch):
    """Every stage is made, has the name that the tiny run's has, and holds the same bits."""
    monkeypatch.setattr(detection, "find", None)  # the run's own process finds nothing
    detection.make("poses")
    assert made(detection) == [*STAGES]
    for output in map(detection.make, STAGES):
        (first,) = (tiny_run.folder / "work").glob(f"*/{output.fingerprint}")
        same_bits(output, first, detection.keys)


def same_bits(output, first, keys):
    assert output.folder != first and output.folder.name == first.name
    for key in keys:
        found, expected = read_arrays(output.folder, key), read_arrays(first, key)
        assert found.keys() == expected.keys()
        for name in found:
            np.testing.assert_array_equal(found[name], expected[name])


def made(detection):
    return [event.stage for event in detection.store.events if not event.reused]


@pytest.mark.parametrize(
    ("executor", "workers", "threads_each"), [("loky", 2, 1), ("threading", 2, 1), ("loky", 1, 2)]
)
def test_workers_of_this_machine_find_the_same_bits(
    tiny_run, work, executor, workers, threads_each, monkeypatch
):
    """However many workers there are, and however many threads each of them has."""
    counts = (f"executor.workers={workers}", f"executor.threads={threads_each}")
    detection = detection_of(tiny_run, work, f"executor={executor}", *counts)
    find_in_workers(detection, tiny_run, monkeypatch)


@contextmanager
def dask_cluster(folder):
    """A scheduler and two workers, each a process of its own; the address, and the workers."""
    known = folder / "scheduler.json"
    source = str(Path(hlp.__file__).parents[1])

    def start(what, *options):
        command = (sys.executable, "-m", f"distributed.cli.dask_{what}", *options)
        with (folder / f"{what}.log").open("ab") as log:
            return subprocess.Popen(
                [*command, "--no-dashboard", "--scheduler-file", known],
                env={**os.environ, "PYTHONPATH": source},
                stderr=log,
            )

    scheduler = start("scheduler", "--host", "127.0.0.1", "--port", "0")
    workers = [start("worker", "--nthreads", "1", "--no-nanny") for _ in range(2)]
    try:
        while not known.exists():
            assert scheduler.poll() is None
            time.sleep(0.1)
        yield json.loads(known.read_text())["address"], workers
    finally:
        for process in (*workers, scheduler):
            process.kill()
            process.wait()


def test_a_dask_worker_that_is_killed_loses_and_doubles_nothing(tiny_run, work, tmp_path, caplog):
    distributed = pytest.importorskip("distributed", reason="dask is not installed")
    shutil.copytree(work, tmp_path / "serial")
    alone = detection_of(tiny_run, tmp_path / "serial", "frames=12")
    alone.make("poses")
    seen = []
    with dask_cluster(tmp_path) as (address, workers):
        with distributed.Client(address) as client:
            client.wait_for_workers(2)
        chosen = ("frames=12", "executor=dask", f"executor.address={address}")
        together = detection_of(tiny_run, work, *chosen)
        together.find = None  # the run's own process finds nothing

        def visit(key, _):
            seen.append(key)
            if len(seen) == 3:
                workers[0].kill()

        together.make("poses", visit)
    assert len(seen) == 12 and {*seen} == {*alone.keys}
    assert caplog.text.count("has gone: others do what it has left") == 1
    for stage in STAGES:
        same_bits(together.make(stage), alone.make(stage).folder, alone.keys)


def test_a_worker_of_other_data_finds_nothing(tiny_run, work, tmp_path):
    detection = detection_of(tiny_run, work, "executor=loky")
    right = Worker.of(detection.training, detection.executor)
    other = dataclasses.replace(right, made_from={**right.made_from, "frames": "others"})
    wrong = partial(other.find, {"regions": tmp_path}, ("regions",))
    with pytest.raises(DataError, match="does not have the same frames as the run"):
        wrong(detection.keys[0])
    assert not list(tmp_path.glob("*.npz"))


def test_two_processes_train_the_classifier(tiny_run, work):
    """Lightning's DDP on the tiny run's windows: another classifier, as good as one process's."""
    cpu, ddp = (detection_of(tiny_run, work, f"trainer={name}") for name in ("cpu", "ddp"))
    one, two = cpu.training.classifier(), ddp.training.classifier()
    assert made(cpu) == [] and made(ddp) == ["classifier"]
    assert one.fingerprint != two.fingerprint
    (expected,), (found,) = read_history(one.folder), read_history(two.folder)
    assert found["loss"] == pytest.approx(expected["loss"], rel=0.2)
    for value in read_weights(two.folder).values():
        assert torch.isfinite(value.float()).all()


@pytest.mark.parametrize("executor", ["loky", "threading"])
def test_workers_render_missing_views_and_the_same(tiny_run, work, executor):
    before = detection_of(tiny_run, work).training
    first, second, *_ = sorted(before.dataset.models)
    expected = {i: before.load_views(i) for i in (first, second)}
    for object_id in expected:
        shutil.rmtree(before.views(object_id).folder)
    run = tiny_run.build(f"work={work}", f"executor={executor}")
    training = stages_of(run, StageStore(work)).training
    assert training.missing_views() == [first, second]
    render_in_workers(training, run.settings.executor)
    assert training.missing_views() == []
    events = [(event.stage, event.of, event.reused) for event in training.store.events]
    names = {training.dataset.models[i].name for i in expected}
    assert sorted(events) == sorted(("views", name, False) for name in names)
    for object_id, views in expected.items():
        found = training.load_views(object_id)
        np.testing.assert_equal(dataclasses.asdict(found), dataclasses.asdict(views))


def test_an_error_in_a_worker_is_the_runs(tiny_run, work, monkeypatch):
    """A frame that cannot be searched, in whichever worker."""

    def fail(*_, **__):
        raise FileNotFoundError("the frame has gone")

    detection = detection_of(tiny_run, work, "executor=threading")
    monkeypatch.setattr("hlp.stages.detection.search_frame", fail)
    with pytest.raises(FileNotFoundError, match="the frame has gone"):
        detection.make("regions")
    assert made(detection) == []
