"""Learns objects from CAD models into one folder; adds objects to it and removes them."""

import hashlib
import json
import logging
import shutil
import sys
import tempfile
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from hlp.codebook.entries import save_codebook
from hlp.errors import DataError, InputError
from hlp.files import read_json, write_json
from hlp.method.backgrounds import Backgrounds
from hlp.method.classifier_training import StartingWeights, train_classifier
from hlp.method.codebook_building import build_codebook
from hlp.method.compute_threads import set_compute_threads
from hlp.method.encoder_training import train_encoder
from hlp.method.learnt_folder import (
    CLASSIFIER,
    ENCODER,
    OBJECTS,
    RECORD,
    LearntFolder,
    LearntRecord,
    read_record,
    write_model,
    write_record,
)
from hlp.method.mesh_models import check_told_apart
from hlp.method.pose_estimator import PoseEstimator
from hlp.method.score_calibration import calibrate_score
from hlp.method.settings import MethodSettings, settings_to_json
from hlp.method.training import read_weights
from hlp.objects.object_model import mesh_identity
from hlp.records import ObjectModel, Views
from hlp.refinement.score_model import save_score_model
from hlp.rendering.views import load_views, render_views, save_views
from hlp.source_code import source_digest

_DONE, _REQUEST, _VIEWS, _SCORE = "done", "request.json", "views", "score"
_ADDED_EPOCHS = 4  # of a classifier that already knows most of its objects


def learn(
    models: Mapping[int, ObjectModel],
    folder: Path,
    settings: MethodSettings,
    backgrounds: Backgrounds,
) -> None:
    """Learn objects from scratch into `folder`, which must not exist yet.

    To continue an interrupted call, repeat it with the same objects.
    """
    record = LearntRecord(
        {model.name: object_id for object_id, model in models.items()}, tuple(models), settings
    )
    if settings.encoder.needs_frames:
        backgrounds.load_encoder_frames()  # raises before anything is trained
    with _folder_in_the_making(folder, learning_request(models, settings, backgrounds)) as partial:
        set_compute_threads(settings.machine.threads)
        views_of = _views(models, partial, settings)
        with _once(partial / CLASSIFIER) as missing:
            if missing:
                train_classifier(models, views_of, backgrounds, settings, partial / CLASSIFIER)
        with _once(partial / ENCODER) as missing:
            if missing:
                train_encoder(models, views_of, backgrounds, settings, partial / ENCODER)
        _write_objects(models, views_of, partial, settings)
        _calibrate_scores(models, backgrounds, partial, record)
        write_record(partial, record)


def add(folder: Path, models: Mapping[int, ObjectModel], backgrounds: Backgrounds) -> None:
    """Learn more objects into a folder of learnt ones.

    The encoder stays as it is; the classifier is trained further with all objects. The folder
    changes only when everything is done. Raises InputError for a name that is already used.
    """
    before = LearntFolder(folder)
    old, settings = before.record, before.record.settings
    for model in models.values():
        if model.name in old.objects:
            raise InputError(f"{folder} knows an object {model.name!r} already: remove it first")
    check_told_apart([*old.objects, *(model.name for model in models.values())])
    known = {**before.models, **models}
    gone = [object_id for object_id in old.classes if object_id not in before.models]
    ids = sorted(known)
    labels = {0: 0} | {
        old_class: ids.index(object_id) + 1
        for old_class, object_id in enumerate(old.classes, 1)
        if object_id not in gone
    }
    weights = read_weights(folder / CLASSIFIER)
    start = StartingWeights(weights, labels, _ADDED_EPOCHS)
    objects = {**old.objects, **{model.name: i for i, model in models.items()}}
    request = learning_request(known, settings, backgrounds)
    with _folder_in_the_making(folder, request, replaces=True) as partial:
        set_compute_threads(settings.machine.threads)
        views_of = _views(known, partial, settings)
        with _once(partial / CLASSIFIER) as missing:
            if missing:
                train_classifier(
                    known, views_of, backgrounds, settings, partial / CLASSIFIER, start
                )
        shutil.copytree(folder / ENCODER, partial / ENCODER, dirs_exist_ok=True)
        for name in old.objects:
            source = folder / OBJECTS / name
            shutil.copytree(source, partial / OBJECTS / name, dirs_exist_ok=True)
        _write_objects(models, views_of, partial, settings)
        record = LearntRecord(objects, tuple(ids), settings)
        _calibrate_scores(models, backgrounds, partial, record)
        write_record(partial, record)


def remove(folder: Path, name: str) -> None:
    """Remove an object from a folder of learnt ones.

    The classifier keeps its class, so that things that look like it are not taken for another
    object. Raises InputError for an unknown name or the last object.
    """
    record = read_record(folder)
    if name not in record.objects:
        raise InputError(f"{folder} knows no object {name!r}; it knows {', '.join(record.objects)}")
    left = {each: i for each, i in record.objects.items() if each != name}
    if not left:
        raise InputError(f"{name!r} is the last object in {folder}: delete the folder instead")
    write_record(folder, LearntRecord(left, record.classes, record.settings))
    shutil.rmtree(folder / OBJECTS / name)


def _write_objects(
    models: Mapping[int, ObjectModel],
    views_of: Callable[[int], Views],
    partial: Path,
    settings: MethodSettings,
) -> None:
    machine = settings.machine
    encoder = settings.encoder.load(partial / ENCODER, machine.threads, machine.device)
    for object_id, model in models.items():
        with _once(partial / OBJECTS / model.name) as missing:
            if missing:
                folder = partial / OBJECTS / model.name
                write_model(folder, model)
                codebook = build_codebook(model, views_of(object_id), encoder, settings)
                save_codebook(folder, codebook)
                settings.codebook.prepare(codebook.features, settings.seed, folder)


def _calibrate_scores(
    models: Mapping[int, ObjectModel],
    backgrounds: Backgrounds,
    partial: Path,
    record: LearntRecord,
) -> None:
    settings = record.settings
    frames = backgrounds.load_background_frames()
    estimator = PoseEstimator(LearntFolder(partial, record=record), settings, tuple(models))
    for object_id, model in models.items():
        with _once(partial / OBJECTS / model.name / _SCORE) as missing:
            if missing:
                score = calibrate_score(
                    estimator, object_id, frames, settings.score.scenes, settings.seed
                )
                save_score_model(partial / OBJECTS / model.name, score)


def _views(
    models: Mapping[int, ObjectModel], partial: Path, settings: MethodSettings
) -> Callable[[int], Views]:
    """Views by object id: rendered once, then read from disk, so that few are held at a time."""

    def views_of(object_id: int) -> Views:
        folder = partial / _VIEWS / str(object_id)
        with _once(folder) as missing:
            if missing:
                views = render_views(
                    models[object_id],
                    settings.rendering,
                    settings.seed,
                    threads=settings.machine.threads,
                )
                save_views(folder, views)
        return load_views(folder, object_id)

    return views_of


@contextmanager
def _folder_in_the_making(
    folder: Path, request: Mapping[str, str], replaces: bool = False
) -> Iterator[Path]:
    """A folder beside `folder` that replaces it when the block ends without an error.

    A folder left by an interrupted call is continued if it is for the same `request`.
    """
    folder = folder.resolve()  # "." has no name, and a link is to stay one
    if folder.exists() and not replaces:
        what = "holds learnt objects" if (folder / RECORD).is_file() else "is there"
        raise InputError(f"{folder} {what} already: load it, or name another folder")
    partial = folder.with_name(folder.name + ".partial")
    if partial.exists() and any(partial.iterdir()) and not (partial / _REQUEST).exists():
        raise InputError(f"{partial} is in the way: rename it, or name another folder")
    with _locked(folder.with_name(f".{folder.name}.lock")):
        if partial.exists() and _readlearning_request(partial) != request:
            shutil.rmtree(partial)
        partial.mkdir(parents=True, exist_ok=True)
        write_json(partial / _REQUEST, request)
        yield partial
        _publish(partial, folder, replaces)
    logging.getLogger(__name__).info("learnt %s", folder)


@contextmanager
def _locked(path: Path) -> Iterator[None]:
    """Keep other processes from learning into the same folder; the system frees a dead one's lock.

    Raises InputError while another process holds it. Without effect on Windows.
    """
    if sys.platform == "win32":
        yield
        return
    import fcntl

    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("w") as stream:
        try:
            fcntl.flock(stream, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            folder = path.name.removeprefix(".").removesuffix(".lock")
            raise InputError(f"another process is learning into {folder}: wait for it") from error
        yield
        path.unlink(missing_ok=True)


def _publish(partial: Path, folder: Path, replaces: bool) -> None:
    """Put a finished folder in its place, without what only an interrupted call would need."""
    shutil.rmtree(partial / _VIEWS)
    (partial / _REQUEST).unlink()
    for done in partial.rglob(_DONE):
        done.unlink()
    if replaces:
        # A name that nothing has: not what an interrupted call left, nor a copy of the user's.
        old = Path(tempfile.mkdtemp(prefix=f".{folder.name}.", dir=folder.parent))
        folder.rename(old / folder.name)
        partial.rename(folder)
        shutil.rmtree(old)
    else:
        partial.rename(folder)


def learning_request(
    models: Mapping[int, ObjectModel], settings: MethodSettings, backgrounds: Backgrounds
) -> dict[str, str]:
    """Identifies all that decides what a folder of learnt objects will hold."""
    digest = hashlib.blake2b(json.dumps(settings_to_json(settings)).encode(), digest_size=16)
    for object_id, model in sorted(models.items()):
        digest.update(f"{object_id} {model.name} {mesh_identity(model.mesh)}".encode())
        digest.update(f"{model.holistic_size} {model.local_size} {len(model.symmetries)}".encode())
    for frame in backgrounds.load_background_frames():
        for array in (frame.rgb, frame.depth, frame.camera_matrix):
            digest.update(f"{array.dtype.str}{array.shape}".encode())
            digest.update(np.ascontiguousarray(array).tobytes())
    return {"made_from": digest.hexdigest(), "source": source_digest(__name__)}


def _readlearning_request(partial: Path) -> object:
    try:
        return read_json(partial / _REQUEST)
    except (OSError, DataError):
        return None


@contextmanager
def _once(folder: Path) -> Iterator[bool]:
    """Whether a folder's content must still be made. The end of the block marks it as made."""
    if (folder / _DONE).exists():
        yield False
        return
    folder.mkdir(parents=True, exist_ok=True)
    yield True
    (folder / _DONE).touch()
