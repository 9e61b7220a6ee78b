"""Rendering of views by workers, an object at a time."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tqdm import tqdm

from hlp.data.dataset import DataSettings
from hlp.method.compute_threads import set_compute_threads
from hlp.method.settings import MethodSettings
from hlp.stages.executor_settings import ExecutorSettings
from hlp.stages.frame_task import check_same, what_makes, with_threads
from hlp.stages.store import StageStore
from hlp.stages.training import TrainingStages


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
