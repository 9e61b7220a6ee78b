"""What all instruments (oracle, basin, bench, search) share: MLflow run, manifest, last words."""

import logging
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from hlp.pipeline.build import Run, evenly
from hlp.pipeline.manifest import FILE, make_manifest, write_json
from hlp.pipeline.store import StageStore
from hlp.pipeline.threads import set_threads
from hlp.pipeline.tracked import log_inputs, revision_tag
from hlp.reporting.tracking import Tracker, how_to_browse, track_run


@contextmanager
def instrument_run(
    planned: Run, output: Path, resume: str | None = None
) -> Iterator[tuple[StageStore, Tracker]]:
    """The store and the MLflow run of one instrument's work.

    After the work `output` gets its manifest.json, all that is in it is logged, and a person is
    told where it is: a folder with a manifest holds a whole result. With `resume` the MLflow run of
    that id goes on. Raises ValueError where the frames have no true poses.
    """
    settings = planned.settings
    if not planned.world.annotated:
        raise ValueError(f"these frames have no true poses, which task={settings.task.name} needs")
    set_threads(settings)
    output.mkdir(parents=True, exist_ok=True)
    (output / FILE).unlink(missing_ok=True)
    name = f"{settings.name} {settings.task.name} {output.name}"
    tags = revision_tag()
    with track_run(settings.reporting, name, planned.config, tags, resume) as tracker:
        log_inputs(planned, tracker)
        store = StageStore(Path(settings.work))
        yield store, tracker
        write_json(output / FILE, make_manifest(planned, store))
        tracker.log_artifacts(output)
    say = logging.getLogger(__name__).info
    written = sorted(path.name for path in output.iterdir() if not path.name.startswith("."))
    say("\nResults   %s (%s)", output, ", ".join(written))
    browse = how_to_browse(settings.reporting, tracker)
    say("MLflow    %s", browse.replace("\n", "\n          "))


def frames_looked_at(planned: Run, count: int | None) -> tuple[str, ...]:
    """`count` of the run's frames, spread evenly (None: all)."""
    return planned.keys if count is None else evenly(planned.keys, count)
