"""What a finished run has learnt, as a folder of learnt objects: for cameras, and as a model."""

import shutil
from pathlib import Path

from hlp.codebook.entries import load_codebook
from hlp.codebook.neighbours import is_joint
from hlp.config.build import Run
from hlp.errors import DataError, MissingFileError
from hlp.method.learn.learnt_folder import (
    CLASSIFIER,
    ENCODER,
    OBJECTS,
    LearntRecord,
    write_searches,
)
from hlp.method.learn.model_files import write_model
from hlp.method.learn.unfinished_folder import finish
from hlp.refinement.score_model import PRIOR, save_score_model
from hlp.stages.manifest import made_outputs
from hlp.stages.store import RECORD, StageStore


def learnt_of_run(run: Run, manifest: Path, folder: Path) -> None:
    """Copy the networks, codebooks and scores that a manifest names into a new `folder`.

    They are those of the run itself, in its folder `work`; nothing is learnt again. Objects that
    the run did not look for have no codebook: the classifier alone knows them. Raises
    MissingFileError for an output that is no longer there, DataError for one that is damaged.
    """
    settings, known = run.settings.method, run.dataset.models
    models = {object_id: known[object_id] for object_id in run.dataset.target_ids}
    outputs = _Outputs(manifest, StageStore(Path(run.settings.work)))
    outputs.copy("classifier", "", folder / CLASSIFIER)
    outputs.copy("encoder", "", folder / ENCODER)
    for model in models.values():
        own = folder / OBJECTS / model.name
        outputs.copy("codebook", model.name, own)
        write_model(own, model)
        if not is_joint(settings.codebook):
            settings.codebook.prepare(load_codebook(own).features, settings.seed, own)
        if settings.score.scenes == 0:
            save_score_model(own, PRIOR)
        else:
            outputs.copy("score", model.name, own)
    ids = {model.name: object_id for object_id, model in models.items()}
    record = LearntRecord(ids, tuple(sorted(known)), settings)
    write_searches(folder, record)
    finish(folder, record)


class _Outputs:
    """The outputs of stages that a manifest names."""

    def __init__(self, manifest: Path, store: StageStore) -> None:
        self._made = made_outputs(manifest)
        self._manifest, self._store = manifest, store

    def copy(self, stage: str, of: str, target: Path) -> None:
        name = self._made.get((stage, of), "")
        source = self._store.root / stage / name
        if not name or not source.is_dir():
            what = " of ".join(filter(None, (stage, of)))
            raise MissingFileError(
                f"{self._store.root} has no {what} that {self._manifest} names: name the folder"
                " of that run with work=FOLDER, or repeat it (hlp run manifest=…)"
            )
        try:
            self._store.read_record(stage, name)  # which compares the checksums
        except DataError as error:
            error.add_note(f"repeat the run of {self._manifest}, which makes it again")
            raise
        shutil.copytree(source, target, ignore=shutil.ignore_patterns(RECORD), dirs_exist_ok=True)
