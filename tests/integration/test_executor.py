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
from hlp.pipeline.build import Run, build_run
from hlp.pipeline.finding import VERSIONS, Finder
from hlp.pipeline.frame_files import read_arrays
from hlp.pipeline.frame_work import FrameWork
from hlp.pipeline.learning import Learner
from hlp.pipeline.store import StageStore
from hlp.pipeline.training import read_history
from hlp.pipeline.view_work import render_in_workers
from tiny_run import TinyRun


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


def planned(tiny_run: TinyRun, work: Path, *overrides: str) -> Run:
    given = (*tiny_run.overrides, f"work={work}", "output=out", *overrides)
    with initialize_config_dir(str(config_folder()), version_base="1.3"):
        return build_run(compose("config", overrides=list(given)))


def finder_of(run: Run, work: Path) -> Finder:
    store = StageStore(work)
    return Finder(run.world, run.settings, Learner(run.world, run.settings, store), store, run.keys)


def assert_same_files(finder: Finder, tiny_run: TinyRun) -> None:
    """Every stage bears the name that the tiny run's has, and holds the same bits but for times."""
    for output in (finder.regions(), finder.hypotheses(), finder.poses()):
        (expected,) = (tiny_run.folder / "work").glob(f"*/{output.fingerprint}")
        assert output.folder != expected
        for key in finder.keys:
            found, wanted = read_arrays(output.folder, key), read_arrays(expected, key)
            assert found.keys() == wanted.keys()
            for name in found:
                if not name.endswith("/seconds"):
                    np.testing.assert_array_equal(found[name], wanted[name])


def made(finder: Finder) -> list[str]:
    return [event.stage for event in finder.store.events if not event.reused]


@pytest.mark.parametrize("executor", ["loky", "threading"])
def test_workers_of_this_machine_find_the_same_bits(
    tiny_run: TinyRun, work: Path, executor: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    finder = finder_of(planned(tiny_run, work, f"executor={executor}"), work)
    monkeypatch.setattr(finder, "find", None)  # the run's own process finds nothing
    finder.poses()
    assert made(finder) == list(VERSIONS)
    assert_same_files(finder, tiny_run)


@pytest.mark.slow
def test_a_dask_cluster_of_two_processes_finds_the_same_bits(
    tiny_run: TinyRun, work: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    distributed = pytest.importorskip("distributed", reason="dask is not installed")
    monkeypatch.setenv("PYTHONPATH", str(Path(hlp.__file__).parents[1]))
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None
    ) as cluster:
        address = cluster.scheduler_address
        run = planned(tiny_run, work, "executor=dask", f"executor.address={address}")
        finder = finder_of(run, work)
        monkeypatch.setattr(finder, "find", None)
        finder.poses()
        with distributed.Client(address) as client:
            at_work = client.run(eval, "'hlp.pipeline.frame_work' in __import__('sys').modules")
    assert list(at_work.values()) == [True, True]  # each of the two has had a frame
    assert made(finder) == list(VERSIONS)
    assert_same_files(finder, tiny_run)


def test_a_worker_of_other_data_finds_nothing(
    tiny_run: TinyRun, work: Path, tmp_path: Path
) -> None:
    finder = finder_of(planned(tiny_run, work, "executor=loky"), work)
    right = FrameWork.of(finder, "regions", tmp_path)
    wrong = FrameWork(**{**vars(right), "made_from": {**right.made_from, "frames": "others"}})
    with pytest.raises(ValueError, match="not the same frames as the run"):
        wrong(finder.keys[0])
    assert not list(tmp_path.glob("*.npz"))


@pytest.mark.slow
def test_two_processes_train_the_classifier(tiny_run: TinyRun, work: Path) -> None:
    """Lightning's DDP on the tiny run's windows: another classifier, as good as one process's."""
    finders = [
        finder_of(planned(tiny_run, work, f"trainer={name}"), work) for name in ("cpu", "ddp")
    ]
    one, two = (finder.learner.classifier() for finder in finders)
    assert made(finders[0]) == [] and made(finders[1]) == ["classifier"]
    assert one.fingerprint != two.fingerprint
    (expected,), (found,) = read_history(one.folder), read_history(two.folder)
    assert found["loss"] == pytest.approx(expected["loss"], rel=0.2)
    network = finders[1].learner.load_classifier()
    for value in network.state_dict().values():
        assert torch.isfinite(value.float()).all()


@pytest.mark.parametrize("executor", ["loky", "threading"])
def test_workers_render_missing_views_and_the_same(
    tiny_run: TinyRun, work: Path, executor: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    learner = finder_of(planned(tiny_run, work, f"executor={executor}"), work).learner
    first, second, *_ = sorted(learner.world.models)
    wanted = {i: learner.load_views(i) for i in (first, second)}
    for object_id in wanted:
        shutil.rmtree(learner.views(object_id).folder)
    learner = finder_of(planned(tiny_run, work, f"executor={executor}"), work).learner
    assert learner.missing_views() == [first, second]
    render_in_workers(learner)
    assert learner.missing_views() == []
    events = [(event.stage, event.of, event.reused) for event in learner.store.events]
    names = {learner.world.models[i].name for i in wanted}
    assert sorted(events) == sorted(("views", name, False) for name in names)
    for object_id, views in wanted.items():
        found = learner.load_views(object_id)
        for field in dataclasses.fields(views):
            np.testing.assert_array_equal(getattr(found, field.name), getattr(views, field.name))


def test_an_error_in_a_worker_is_the_runs(tiny_run: TinyRun, work: Path) -> None:
    """A classifier that cannot be read, seen by whoever loads it first: a worker."""
    finder = finder_of(planned(tiny_run, work, "executor=threading"), work)
    (weights,) = (work / "classifier").glob("*/weights.pt")
    weights.unlink()
    with pytest.raises(FileNotFoundError, match=r"weights\.pt"):
        finder.regions()
    assert made(finder) == []
