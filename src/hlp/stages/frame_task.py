"""The detection stages on one frame, as a worker gets them: settings and folders, no images."""

import threading
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from hlp.data.dataset import Dataset
from hlp.data.loading import DataSettings, build_dataset
from hlp.method.compute_threads import set_compute_threads
from hlp.method.settings import MethodSettings
from hlp.stages.detection import DetectionStages, Seconds
from hlp.stages.executor_settings import SerialSettings
from hlp.stages.fingerprint import with_threads
from hlp.stages.provenance import code_digest, library_versions
from hlp.stages.store import Output, StageStore
from hlp.stages.training import TrainingStages

# A worker's own: data set, networks and codebooks stay loaded from frame to frame.
_KEPT = threading.local()


@dataclass(frozen=True)
class FrameTask:
    """What a worker needs to find in a frame what the run's own process would find, bit for bit.

    `learnt` and `found` are the outputs that the stages start from; a worker makes none of them.
    `made_from` are the versions, the code and the data that it must have as well.
    """

    data: DataSettings
    settings: MethodSettings
    work: Path
    made_from: Mapping[str, Any]
    learnt: Mapping[tuple[str, int], Output]
    found: Mapping[str, Output]
    folders: Mapping[str, Path]
    missing: tuple[str, ...]

    @classmethod
    def of(
        cls, detection: DetectionStages, folders: Mapping[str, Path], missing: tuple[str, ...]
    ) -> "FrameTask":
        """The task of making the missing stages' files in their folders."""
        executor = detection.executor
        assert executor is not None and not isinstance(executor, SerialSettings)
        return cls(
            detection.dataset.settings,
            with_threads(detection.settings, executor.threads),
            detection.store.root,
            what_makes(detection.dataset),
            detection.training.made,
            detection.made,
            folders,
            missing,
        )

    def __call__(self, key: str) -> tuple[str, Seconds]:
        """Write a frame's files; its key, and the time of each object's steps.

        Raises ValueError where code or data are not the run's.
        """
        detection = self._detection()
        detection.training.adopt(self.learnt)
        detection.adopt(self.found)
        return key, detection.find(key, self.folders, self.missing)

    def _detection(self) -> DetectionStages:
        kept: DetectionStages | None = getattr(_KEPT, "detection", None)
        if kept is None or kept.settings != self.settings or _KEPT.made_from != self.made_from:
            set_compute_threads(self.settings.machine.threads)
            dataset = build_dataset(self.data)
            check_same(self.made_from, dataset)
            store = StageStore(self.work)
            training = TrainingStages(dataset, self.settings, store)
            kept = DetectionStages(dataset, self.settings, training, store, ())
            _KEPT.detection, _KEPT.made_from = kept, self.made_from
        return kept


def what_makes(dataset: Dataset) -> dict[str, Any]:
    """What must be the same where results are to be the same: versions, code and data."""
    return {
        "versions": library_versions(),
        "code": code_digest(),
        "frames": dataset.frames_identity,
        "models": dataset.model_identities,
    }


def check_same(made_from: Mapping[str, Any], dataset: Dataset) -> None:
    """Raise ValueError where this process, a worker, has not what the run has."""
    here = what_makes(dataset)
    other = [name for name, value in made_from.items() if here[name] != value]
    if other:
        raise ValueError(f"a worker has not the same {', '.join(other)} as the run")
