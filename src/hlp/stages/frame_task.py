"""Frames and views by a worker. It is sent settings and folders, and reads the images."""

import threading
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from socket import gethostname
from typing import Any

from hlp.data.dataset import Dataset, DataSettings
from hlp.errors import DataError, MissingFileError
from hlp.method.find.trace import Stage
from hlp.method.settings import MethodSettings
from hlp.progress import Progress
from hlp.stages.detection import DetectionStages, OnBadFrame, Seconds
from hlp.stages.executor_settings import ExecutorSettings
from hlp.stages.manifest import code_digest, library_versions
from hlp.stages.store import Output, StageStore
from hlp.stages.training import TrainingStages
from hlp.threads import set_compute_threads

# Per worker: its data set, networks and codebooks stay loaded between frames.
_KEPT = threading.local()


@dataclass(frozen=True)
class Worker:
    """Everything that a worker needs to compute like the run's own process, bit for bit.

    `made_from` are the versions, code and data that the worker must have too. `learnt` are the
    finished outputs that detection starts from.
    """

    data: DataSettings
    settings: MethodSettings
    work: Path
    made_from: Mapping[str, Any]
    learnt: Mapping[tuple[str, int], Output]
    on_bad_frame: OnBadFrame = "fail"

    @classmethod
    def of(
        cls, training: TrainingStages, executor: ExecutorSettings, on_bad_frame: OnBadFrame = "fail"
    ) -> "Worker":
        """A worker of an executor."""
        data, settings = training.dataset.settings, training.settings
        assert data is not None
        own = replace(settings, machine=replace(settings.machine, threads=executor.threads))
        work, made_from = training.store.root, what_makes(training.dataset)
        return cls(data, own, work, made_from, dict(training.made), on_bad_frame)

    def stages(self) -> DetectionStages:
        """The stages in the worker, as long as it works for one run.

        They are others for the same settings with other learnt outputs: other training images make
        other networks. Raises DataError if the worker's code or data are not those of the run,
        and MissingFileError if it does not see the run's folder.
        """
        kept: DetectionStages | None = getattr(_KEPT, "detection", None)
        if kept is None or _KEPT.worker != self:
            set_compute_threads(self.settings.machine.threads)
            host = gethostname()
            if not self.work.is_dir():
                raise MissingFileError(f"{self.work} (work) is not there for the worker on {host}")
            dataset = self.data.build()
            here = what_makes(dataset)
            other = [name for name, value in self.made_from.items() if here[name] != value]
            if other:
                raise DataError(
                    f"the worker on {host} does not have the same {', '.join(other)} as the run"
                )
            training = TrainingStages(dataset, self.settings, StageStore(self.work))
            training.made.update(self.learnt)
            of = dataset, self.settings, training, ()
            kept = DetectionStages(*of, on_bad_frame=self.on_bad_frame)
            _KEPT.detection, _KEPT.worker = kept, self
        return kept

    def find(
        self, folders: Mapping[Stage, Path], missing: Sequence[Stage], key: str
    ) -> tuple[str, Seconds]:
        """Write a frame's files of missing stages; its key and the time of each object's steps."""
        return key, self.stages().find(key, folders, missing)

    def render(self, key: str) -> str:
        """Put the views of the object with this id into the store; return the id."""
        self.stages().training.views(int(key))
        return key


def what_makes(dataset: Dataset) -> dict[str, Any]:
    """What must be equal for results to be equal: versions, code and data."""
    return {
        "versions": library_versions(),
        "code": code_digest(),
        "frames": dataset.frames_identity,
        "models": dataset.model_identities,
    }


def render_in_workers(training: TrainingStages, executor: ExecutorSettings) -> None:
    """Have missing views rendered by the executor's workers. The serial executor has none."""
    missing = [str(object_id) for object_id in training.missing_views()]
    if not executor.parallel or not missing:
        return
    done = executor.each(Worker.of(training, executor).render, missing)
    for key in Progress(done, desc="views", unit="object", total=len(missing)):
        training.take_views(int(key))
