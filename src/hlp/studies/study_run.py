"""What all studies (oracle, basin, bench, search) share: MLflow run, manifest, final message."""

import logging
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any

import numpy as np

from hlp.config.build import Run
from hlp.files import MANIFEST, write_json
from hlp.fingerprints import Code, code_of
from hlp.progress import Progress
from hlp.records import Frame
from hlp.reporting.mlflow.run import MlflowRun
from hlp.reporting.page import page_or_log, write_study_page
from hlp.reporting.study_numbers import KINDS, read_numbers
from hlp.runs.manifest import make_manifest
from hlp.runs.mlflow_log import begun, say_where
from hlp.settings import CountOrNone, Doc
from hlp.stages.manifest import described, fingerprint
from hlp.stages.store import StageStore
from hlp.stages.trace_files import has_arrays, write_arrays

FrameCount = Annotated[
    CountOrNone, Doc("number of frames, spread evenly over the run's; null: all (D)")
]
"""How many frames a study looks at."""


@contextmanager
def study_run(
    run: Run, output: Path, resume: str | None = None
) -> Iterator[tuple[StageStore, MlflowRun]]:
    """The store and the MLflow run of one study.

    When the block ends, manifest.json and report.html are written into `output`, its numbers and
    all that is in it are logged, and a message says where it is. A folder with a manifest holds a
    complete result.
    With `resume` the MLflow run of that id is continued.
    """
    with begun(run, output, resume) as (store, tracker):
        yield store, tracker
        study = run.settings.task.name
        numbers = read_numbers(output, KINDS[study]).values()
        tracker.log_metrics({f"{study}/{number.name}": number.value for number in numbers})
        write_json(output / MANIFEST, make_manifest(run, store))
        page_or_log(write_study_page, output)
        tracker.log_artifacts(output)
    written = sorted(path.name for path in output.iterdir() if not path.name.startswith("."))
    logging.getLogger(__name__).info("\nResults   %s (%s)", output, ", ".join(written))
    say_where(run, tracker)


def study_code(module: str, *alternatives: object) -> Code:
    """The code of a study and of what its settings choose, which no module imports by name.

    `alternatives` are the settings of refiners, encoders, …, and the source of the frames.
    """
    return code_of(module, *sorted({type(settings).__module__ for settings in alternatives}))


def stage_of_frames(
    study: str,
    run: Run,
    store: StageStore,
    keys: Sequence[str],
    find: Callable[[Frame], dict[str, np.ndarray]],
    code: Code,
    decided: Mapping[str, Any],
    upstream: Mapping[str, str],
    label: str = "",
) -> Path:
    """Folder with the arrays that `find` makes of each frame, one file per frame.

    It is made once for the same settings (`decided`), inputs (`upstream`) and code; an interrupted
    study continues where it stopped.
    """
    settings = {**decided, "keys": list(keys)}

    def make(folder: Path) -> None:
        for key in Progress(keys, desc=f"{study} of {label}" if label else study, unit="frame"):
            if not has_arrays(folder, key):
                write_arrays(folder, key, find(run.dataset.frames.load(key)))

    description = described(settings, upstream, run.settings.seed, code)
    return store.get_or_make(study, fingerprint(study, description), make, description, label)
