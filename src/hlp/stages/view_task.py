"""Views of several objects shared out to workers, an object to each."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tqdm import tqdm

from hlp.config.build import build_dataset
from hlp.config.settings import RunSettings, SerialSettings, with_threads
from hlp.method.compute_threads import set_threads
from hlp.stages.executor import each_in_workers
from hlp.stages.frame_task import check_same, what_makes
from hlp.stages.store import StageStore
from hlp.stages.training import TrainingStages


@dataclass(frozen=True)
class ViewTask:
    """What a worker needs to render the views that the run's own process would render."""

    settings: RunSettings
    made_from: Mapping[str, Any]

    def __call__(self, key: str) -> str:
        """Put the views of an object, by its id, into the store; its id.

        Raises ValueError where code or data are not the run's.
        """
        set_threads(self.settings)
        dataset = build_dataset(self.settings)
        check_same(self.made_from, dataset)
        TrainingStages(dataset, self.settings, StageStore(Path(self.settings.work))).views(int(key))
        return key


def render_in_workers(training: TrainingStages) -> None:
    """Have the views that are not on disk rendered by the executor's workers, if there are any."""
    executor = training.settings.executor
    missing = [str(object_id) for object_id in training.missing_views()]
    if isinstance(executor, SerialSettings) or not missing:
        return
    work = ViewTask(with_threads(training.settings, executor.threads), what_makes(training.dataset))
    done = each_in_workers(executor, work, missing)
    for key in tqdm(done, desc="views", unit="object", total=len(missing), disable=None):
        training.take_views(int(key))
