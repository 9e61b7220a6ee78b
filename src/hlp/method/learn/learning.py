"""Learns objects from CAD models into one folder; adds objects to it and removes them."""

import hashlib
import json
import shutil
from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np

from hlp.codebook.entries import save_codebook
from hlp.codebook.neighbours import is_joint
from hlp.errors import InputError
from hlp.fingerprints import source_digest
from hlp.method.learn.classifier_training import train_classifier
from hlp.method.learn.codebook_building import build_codebook
from hlp.method.learn.encoder_training import train_encoder
from hlp.method.learn.learnt_folder import (
    CLASSIFIER,
    ENCODER,
    OBJECTS,
    SEARCHES,
    LearntFolder,
    LearntRecord,
    check_files,
    read_record,
    write_record,
    write_searches,
)
from hlp.method.learn.mesh_models import check_distinct
from hlp.method.learn.model_files import StartingWeights, read_weights, write_model
from hlp.method.learn.training import free_memory
from hlp.method.learn.unfinished_folder import VIEWS, finish, folder_in_the_making, once
from hlp.method.settings import ClassifierStage, CodebookStage, EncoderStage, MethodSettings
from hlp.objects.object_model import mesh_identity
from hlp.patches.backgrounds import Backgrounds
from hlp.records import ObjectModel, Views
from hlp.rendering.views import load_views, render_views, save_views
from hlp.threads import set_compute_threads

_ADDED_EPOCHS = 4  # of a classifier that already knows most of its objects


def learn(
    models: Mapping[int, ObjectModel],
    folder: Path,
    settings: MethodSettings,
    backgrounds: Backgrounds,
) -> None:
    """Learn objects from scratch into `folder`, which must not exist yet.

    To continue an interrupted call, repeat it with the same objects. A damaged folder of learnt
    objects is renamed, and they are learnt again.
    """
    names = {model.name: object_id for object_id, model in models.items()}
    record = LearntRecord(names, tuple(models), settings)
    if settings.encoder.needs_frames:
        backgrounds.load_encoder_frames()  # raises before anything is trained
    with folder_in_the_making(folder, learning_request(models, settings, backgrounds)) as place:
        making = _Making(place, record, models, backgrounds)
        making.train_classifier()
        making.train_encoder()
        making.add_objects(models)


def add(folder: Path, models: Mapping[int, ObjectModel], backgrounds: Backgrounds) -> None:
    """Learn more objects into a folder of learnt ones.

    The encoder stays as it is; the classifier is trained further with all objects. The folder
    changes only when everything is done. Raises InputError for a name that is already used, and
    DataError if a file of the folder is damaged.
    """
    before = LearntFolder(folder)
    old, settings = before.record, before.record.settings
    check_files(folder, old)
    names = {model.name: object_id for object_id, model in models.items()}
    for name in names:
        if name in old.objects:
            raise InputError(f"{folder} knows an object {name!r} already: remove it first")
    check_distinct([*old.objects, *names])
    known = {**before.models, **models}
    new_label = {object_id: label for label, object_id in enumerate(sorted(known), 1)}
    labels = {0: 0} | {
        label: new_label[object_id]
        for label, object_id in enumerate(old.classes, 1)
        if object_id in before.models  # others were removed
    }
    start = StartingWeights(read_weights(folder / CLASSIFIER), labels, _ADDED_EPOCHS)
    record = LearntRecord({**old.objects, **names}, tuple(new_label), settings)
    request = learning_request(known, settings, backgrounds)
    with folder_in_the_making(folder, request, replaces=True) as place:
        making = _Making(place, record, known, backgrounds)
        making.train_classifier(start)
        for kept in (ENCODER, *(f"{OBJECTS}/{name}" for name in old.objects)):
            shutil.copytree(folder / kept, place / kept, dirs_exist_ok=True)
        making.add_objects(models)


def remove(folder: Path, name: str) -> None:
    """Remove an object from a folder of learnt ones.

    The classifier keeps its class, so that things that look like it are not taken for another
    object. Raises InputError for an unknown name or the last object.
    """
    record = read_record(folder)
    if name not in record.objects:
        raise InputError(f"{folder} knows no object {name!r}; it knows {', '.join(record.objects)}")
    left = {other: object_id for other, object_id in record.objects.items() if other != name}
    if not left:
        raise InputError(f"{name!r} is the last object in {folder}: delete the folder instead")
    gone = (f"{OBJECTS}/{name}/", f"{SEARCHES}/")
    files = {path: checksum for path, checksum in record.files.items() if not path.startswith(gone)}
    kept = replace(record, objects=left, files=files)
    searches = write_searches(folder, kept)
    write_record(folder, replace(kept, files={**files, **searches}))
    shutil.rmtree(folder / OBJECTS / name)
    needed = {path.split("/")[1] for path in searches}
    for part in (folder / SEARCHES).glob("*"):
        if part.name not in needed:
            shutil.rmtree(part)


@dataclass(frozen=True)
class _Making:
    """Makes the parts of a folder, each once: `models` are all objects of its classifier."""

    folder: Path
    record: LearntRecord
    models: Mapping[int, ObjectModel]
    backgrounds: Backgrounds

    def views(self, object_id: int) -> Views:
        """Rendered once, then read from disk, so that few are held at a time."""
        settings, folder = self.record.settings, self.folder / VIEWS / str(object_id)

        def make(folder: Path) -> None:
            model, threads = self.models[object_id], settings.machine.threads
            views = render_views(model, settings.rendering, settings.seed, threads=threads)
            save_views(folder, views)

        once(folder, make)
        return load_views(folder, object_id)

    def train_classifier(self, start: StartingWeights | None = None) -> None:
        set_compute_threads(self.record.settings.machine.threads)
        of = self.models, self.views, self.backgrounds, ClassifierStage.of(self.record.settings)
        once(self.folder / CLASSIFIER, lambda folder: train_classifier(*of, folder, start))
        free_memory()

    def train_encoder(self) -> None:
        of = self.models, self.views, self.backgrounds, EncoderStage.of(self.record.settings)
        once(self.folder / ENCODER, lambda folder: train_encoder(*of, folder))

    def add_objects(self, models: Mapping[int, ObjectModel]) -> None:
        """Models and codebooks of some objects; then the folder is complete."""
        for model in models.values():
            once(self.folder / OBJECTS / model.name, partial(self._write_object, model))
            free_memory()
        write_searches(self.folder, self.record)
        finish(self.folder, self.record)

    def _write_object(self, model: ObjectModel, folder: Path) -> None:
        settings = self.record.settings
        machine, stage = settings.machine, CodebookStage.of(settings)
        encoder = settings.encoder.load(self.folder / ENCODER, machine.threads, machine.device)
        write_model(folder, model)
        free_memory()
        codebook = build_codebook(model, self.views(model.object_id), encoder, stage)
        save_codebook(folder, codebook)
        if not is_joint(settings.codebook):
            settings.codebook.prepare(codebook.features, settings.seed, folder)


def learning_request(
    models: Mapping[int, ObjectModel], settings: MethodSettings, backgrounds: Backgrounds
) -> dict[str, str]:
    """Identifies all that decides what a folder of learnt objects will hold."""
    digest = hashlib.blake2b(json.dumps(asdict(settings)).encode(), digest_size=16)
    for object_id, model in sorted(models.items()):
        digest.update(f"{object_id} {model.name} {mesh_identity(model.mesh)}".encode())
        digest.update(f"{model.holistic_size} {model.local_size} {len(model.symmetries)}".encode())
    for frame in backgrounds.load_background_frames():
        for array in (frame.rgb, frame.depth, frame.camera_matrix):
            digest.update(f"{array.dtype.str}{array.shape}".encode())
            digest.update(np.ascontiguousarray(array).tobytes())
    return {"made_from": digest.hexdigest(), "source": source_digest(__name__)}
