"""A stage's work on one frame, as a worker gets it: settings and folders, no data, no networks."""

import threading
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from hlp.config.build import build_dataset
from hlp.config.settings import RunSettings, SerialSettings, with_threads
from hlp.data.dataset import Dataset
from hlp.method.compute_threads import set_threads
from hlp.stages.detection import DetectionStages
from hlp.stages.provenance import code_digest, library_versions
from hlp.stages.store import Output, StageStore
from hlp.stages.training import TrainingStages

# A worker's own: dataset, networks and codebooks stay loaded from frame to frame.
_KEPT = threading.local()


@dataclass(frozen=True)
class FrameTask:
    """What a worker needs to find in a frame what the run's own process would find, bit for bit.

    `learnt` and `found` are the outputs that stand before the stage; a worker makes none of them.
    `made_from` are the versions, the code and the data that it must have as well.
    """

    settings: RunSettings
    made_from: Mapping[str, Any]
    learnt: Mapping[tuple[str, int], Output]
    found: Mapping[str, Output]
    stage: str
    folder: Path

    @classmethod
    def of(cls, detection: DetectionStages, stage: str, folder: Path) -> "FrameTask":
        """The work of a detection's stage, which writes into a folder."""
        executor = detection.settings.executor
        assert not isinstance(executor, SerialSettings)
        settings = with_threads(detection.settings, executor.threads)
        made_from = what_makes(detection.dataset)
        return cls(settings, made_from, detection.training.made, detection.made, stage, folder)

    def __call__(self, key: str) -> str:
        """Write a frame's file; its key. Raises ValueError where code or data are not the run's."""
        detection = self._detection()
        detection.training.adopt(self.learnt)
        detection.adopt(self.found)
        detection.find(self.stage, self.folder, key)
        return key

    def _detection(self) -> DetectionStages:
        kept: DetectionStages | None = getattr(_KEPT, "detection", None)
        if kept is None or kept.settings != self.settings or _KEPT.made_from != self.made_from:
            set_threads(self.settings)
            dataset = build_dataset(self.settings)
            check_same(self.made_from, dataset)
            store = StageStore(Path(self.settings.work))
            kept = DetectionStages(
                dataset, self.settings, TrainingStages(dataset, self.settings, store), store, ()
            )
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
