"""A stage's work on one frame, as a worker gets it: settings and folders, no data, no networks."""

import threading
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from hlp.pipeline.build import build_world
from hlp.pipeline.finding import Finder
from hlp.pipeline.learning import Learner
from hlp.pipeline.provenance import code_digest, library_versions
from hlp.pipeline.settings import RunSettings, SerialSettings, with_threads
from hlp.pipeline.store import Output, StageStore
from hlp.pipeline.threads import set_threads
from hlp.pipeline.world import World

# A worker's own: world, networks and codebooks stay loaded from frame to frame.
_KEPT = threading.local()


@dataclass(frozen=True)
class FrameWork:
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
    def of(cls, finder: Finder, stage: str, folder: Path) -> "FrameWork":
        """The work of a finder's stage, which writes into a folder."""
        executor = finder.settings.executor
        assert not isinstance(executor, SerialSettings)
        settings = with_threads(finder.settings, executor.threads)
        made_from = what_makes(finder.world)
        return cls(settings, made_from, finder.learner.made, finder.made, stage, folder)

    def __call__(self, key: str) -> str:
        """Write a frame's file; its key. Raises ValueError where code or data are not the run's."""
        finder = self._finder()
        finder.learner.adopt(self.learnt)
        finder.adopt(self.found)
        finder.find(self.stage, self.folder, key)
        return key

    def _finder(self) -> Finder:
        kept: Finder | None = getattr(_KEPT, "finder", None)
        if kept is None or kept.settings != self.settings or _KEPT.made_from != self.made_from:
            set_threads(self.settings)
            world = build_world(self.settings)
            check_same(self.made_from, world)
            store = StageStore(Path(self.settings.work))
            kept = Finder(world, self.settings, Learner(world, self.settings, store), store, ())
            _KEPT.finder, _KEPT.made_from = kept, self.made_from
        return kept


def what_makes(world: World) -> dict[str, Any]:
    """What must be the same where results are to be the same: versions, code and data."""
    return {
        "versions": library_versions(),
        "code": code_digest(),
        "frames": world.frames_identity,
        "models": world.model_identities,
    }


def check_same(made_from: Mapping[str, Any], world: World) -> None:
    """Raise ValueError where this process, a worker, has not what the run has."""
    here = what_makes(world)
    other = [name for name, value in made_from.items() if here[name] != value]
    if other:
        raise ValueError(f"a worker has not the same {', '.join(other)} as the run")
