"""Views of several objects shared out to workers, an object to each."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tqdm import tqdm

from hlp.pipeline.build import build_world
from hlp.pipeline.executor import each_in_workers
from hlp.pipeline.frame_work import check_same, what_makes
from hlp.pipeline.learning import Learner
from hlp.pipeline.settings import RunSettings, SerialSettings, with_threads
from hlp.pipeline.store import StageStore
from hlp.pipeline.threads import set_threads


@dataclass(frozen=True)
class ViewWork:
    """What a worker needs to render the views that the run's own process would render."""

    settings: RunSettings
    made_from: Mapping[str, Any]

    def __call__(self, key: str) -> str:
        """Put the views of an object, by its id, into the store; its id.

        Raises ValueError where code or data are not the run's.
        """
        set_threads(self.settings)
        world = build_world(self.settings)
        check_same(self.made_from, world)
        Learner(world, self.settings, StageStore(Path(self.settings.work))).views(int(key))
        return key


def render_in_workers(learner: Learner) -> None:
    """Have the views that are not on disk rendered by the executor's workers, if there are any."""
    executor = learner.settings.executor
    missing = [str(object_id) for object_id in learner.missing_views()]
    if isinstance(executor, SerialSettings) or not missing:
        return
    work = ViewWork(with_threads(learner.settings, executor.threads), what_makes(learner.world))
    done = each_in_workers(executor, work, missing)
    for key in tqdm(done, desc="views", unit="object", total=len(missing), disable=None):
        learner.take_views(int(key))
