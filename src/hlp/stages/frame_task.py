"""Detection in one frame by a worker. It is sent settings and folders, and reads the images."""

import threading
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from tqdm import tqdm

from hlp.data.dataset import Dataset, DataSettings
from hlp.errors import DataError
from hlp.method.compute_threads import set_compute_threads
from hlp.method.find.trace import Stage
from hlp.method.settings import MethodSettings
from hlp.stages.detection import DetectionStages, OnBadFrame, Seconds
from hlp.stages.executor_settings import ExecutorSettings
from hlp.stages.manifest import code_digest, library_versions
from hlp.stages.store import Output, StageStore
from hlp.stages.training import TrainingStages

# Per worker: its data set, networks and codebooks stay loaded between frames.
_KEPT = threading.local()


@dataclass(frozen=True)
class FrameTask:
    """Everything that a worker needs to process a frame like the run's own process.

    Results are the same bit for bit. `learnt` and `found` are the finished outputs that the stages
    start from. `made_from` are the versions, code and data that the worker must have too.
    """

    data: DataSettings
    settings: MethodSettings
    work: Path
    made_from: Mapping[str, Any]
    learnt: Mapping[tuple[str, int], Output]
    found: Mapping[str, Output]
    folders: Mapping[Stage, Path]
    missing: tuple[Stage, ...]
    on_bad_frame: OnBadFrame = "fail"

    @classmethod
    def of(
        cls, detection: DetectionStages, folders: Mapping[Stage, Path], missing: tuple[Stage, ...]
    ) -> "FrameTask":
        """The task of writing the missing stages' files into their folders."""
        executor = detection.executor
        data = detection.dataset.settings
        assert executor is not None and data is not None
        return cls(
            data,
            with_threads(detection.settings, executor.threads),
            detection.store.root,
            what_makes(detection.dataset),
            detection.training.made,
            detection.made,
            folders,
            missing,
            detection.on_bad_frame,
        )

    def __call__(self, key: str) -> tuple[str, Seconds]:
        """Write a frame's files; return its key and the time of each object's steps.

        Raises DataError if the worker's code or data are not those of the run.
        """
        detection = self._detection()
        detection.training.adopt(self.learnt)
        detection.adopt(self.found)
        return key, detection.find(key, self.folders, self.missing)

    def _detection(self) -> DetectionStages:
        # Not only the settings: the same ones on other training images make other networks, which
        # `learnt` names.
        same = (
            self.settings, self.data, self.work, dict(self.made_from), dict(self.learnt),
            self.on_bad_frame,
        )  # fmt: skip
        kept: DetectionStages | None = getattr(_KEPT, "detection", None)
        if kept is None or _KEPT.same != same:
            set_compute_threads(self.settings.machine.threads)
            dataset = self.data.build()
            check_same(self.made_from, dataset)
            store = StageStore(self.work)
            training = TrainingStages(dataset, self.settings, store)
            kept = DetectionStages(
                dataset, self.settings, training, store, (), on_bad_frame=self.on_bad_frame
            )
            _KEPT.detection, _KEPT.same = kept, same
        return kept


def with_threads(settings: MethodSettings, threads: int) -> MethodSettings:
    """The same settings for a worker with another number of threads."""
    return replace(settings, machine=replace(settings.machine, threads=threads))


def what_makes(dataset: Dataset) -> dict[str, Any]:
    """What must be equal for results to be equal: versions, code and data."""
    return {
        "versions": library_versions(),
        "code": code_digest(),
        "frames": dataset.frames_identity,
        "models": dataset.model_identities,
    }


def check_same(made_from: Mapping[str, Any], dataset: Dataset) -> None:
    """Raise DataError if this process, a worker, has other code or data than the run."""
    here = what_makes(dataset)
    other = [name for name, value in made_from.items() if here[name] != value]
    if other:
        raise DataError(f"a worker does not have the same {', '.join(other)} as the run")


@dataclass(frozen=True)
class ViewTask:
    """Everything that a worker needs to render views like the run's own process."""

    data: DataSettings
    settings: MethodSettings
    work: Path
    made_from: Mapping[str, Any]

    def __call__(self, key: str) -> str:
        """Put the views of the object with this id into the store; return the id.

        Raises DataError if the worker's code or data are not those of the run.
        """
        set_compute_threads(self.settings.machine.threads)
        dataset = self.data.build()
        check_same(self.made_from, dataset)
        TrainingStages(dataset, self.settings, StageStore(self.work)).views(int(key))
        return key


def render_in_workers(training: TrainingStages, executor: ExecutorSettings) -> None:
    """Have missing views rendered by the executor's workers. The serial executor has none."""
    missing = [str(object_id) for object_id in training.missing_views()]
    if not executor.parallel or not missing:
        return
    dataset = training.dataset
    settings = with_threads(training.settings, executor.threads)
    assert dataset.settings is not None
    task = ViewTask(dataset.settings, settings, training.store.root, what_makes(dataset))
    done = executor.each(task, missing)
    for key in tqdm(done, desc="views", unit="object", total=len(missing), disable=None):
        training.take_views(int(key))
