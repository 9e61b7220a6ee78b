"""Learns objects from CAD models into one folder; adds objects to it and removes them."""

import hashlib
import json
import shutil
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from hlp.codebook.entries import save_codebook
from hlp.codebook.neighbours import is_joint
from hlp.errors import InputError
from hlp.method.compute_threads import set_compute_threads
from hlp.method.find.estimator import PoseEstimator
from hlp.method.learn.backgrounds import Backgrounds
from hlp.method.learn.checkpoints import StartingWeights, read_weights
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
    remove_stale_searches,
    write_record,
    write_searches,
)
from hlp.method.learn.mesh_models import check_told_apart
from hlp.method.learn.model_files import write_model
from hlp.method.learn.progress import counting_objects
from hlp.method.learn.score_calibration import calibrate_score
from hlp.method.learn.unfinished_folder import SCORED, VIEWS, finish, folder_in_the_making, once
from hlp.method.settings import MethodSettings, settings_to_json
from hlp.method.stage_settings import ClassifierStage, CodebookStage, EncoderStage, FindSettings
from hlp.objects.object_model import mesh_identity
from hlp.records import ObjectModel, Views
from hlp.refinement.score_model import save_score_model
from hlp.rendering.views import load_views, render_views, save_views
from hlp.source_code import source_digest

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
    record = LearntRecord(
        {model.name: object_id for object_id, model in models.items()}, tuple(models), settings
    )
    if settings.encoder.needs_frames:
        backgrounds.load_encoder_frames()  # raises before anything is trained
    with folder_in_the_making(folder, learning_request(models, settings, backgrounds)) as partial:
        set_compute_threads(settings.machine.threads)
        views_of = _views(models, partial, settings)
        with once(partial / CLASSIFIER) as missing:
            if missing:
                train_classifier(
                    models,
                    views_of,
                    backgrounds,
                    ClassifierStage.of(settings),
                    partial / CLASSIFIER,
                )
        with once(partial / ENCODER) as missing:
            if missing:
                counted = counting_objects(views_of, "pairs cut", len(models))
                stage = EncoderStage.of(settings)
                train_encoder(models, counted, backgrounds, stage, partial / ENCODER)
        _write_objects(models, views_of, partial, settings)
        write_searches(partial, record)
        _calibrate_scores(models, backgrounds, partial, record)
        finish(partial, record)


def add(folder: Path, models: Mapping[int, ObjectModel], backgrounds: Backgrounds) -> None:
    """Learn more objects into a folder of learnt ones.

    The encoder stays as it is; the classifier is trained further with all objects. The folder
    changes only when everything is done. Raises InputError for a name that is already used, and
    DataError if a file of the folder is damaged.
    """
    before = LearntFolder(folder)
    old, settings = before.record, before.record.settings
    check_files(folder, old)
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
    with folder_in_the_making(folder, request, replaces=True) as partial:
        set_compute_threads(settings.machine.threads)
        views_of = _views(known, partial, settings)
        with once(partial / CLASSIFIER) as missing:
            if missing:
                train_classifier(
                    known,
                    views_of,
                    backgrounds,
                    ClassifierStage.of(settings),
                    partial / CLASSIFIER,
                    start,
                )
        shutil.copytree(folder / ENCODER, partial / ENCODER, dirs_exist_ok=True)
        for name in old.objects:
            source = folder / OBJECTS / name
            shutil.copytree(source, partial / OBJECTS / name, dirs_exist_ok=True)
        _write_objects(models, views_of, partial, settings)
        record = LearntRecord(objects, tuple(ids), settings)
        write_searches(partial, record)
        _calibrate_scores(models, backgrounds, partial, record)
        finish(partial, record)


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
    gone = (f"{OBJECTS}/{name}/", f"{SEARCHES}/")
    files = {path: each for path, each in record.files.items() if not path.startswith(gone)}
    kept = replace(record, objects=left, files=files)
    kept = replace(kept, files={**files, **write_searches(folder, kept)})
    write_record(folder, kept)
    shutil.rmtree(folder / OBJECTS / name)
    remove_stale_searches(folder, kept)


def _write_objects(
    models: Mapping[int, ObjectModel],
    views_of: Callable[[int], Views],
    partial: Path,
    settings: MethodSettings,
) -> None:
    machine = settings.machine
    encoder = settings.encoder.load(partial / ENCODER, machine.threads, machine.device)
    for object_id, model in models.items():
        with once(partial / OBJECTS / model.name) as missing:
            if missing:
                folder = partial / OBJECTS / model.name
                write_model(folder, model)
                codebook = build_codebook(
                    model, views_of(object_id), encoder, CodebookStage.of(settings)
                )
                save_codebook(folder, codebook)
                if not is_joint(settings.codebook):
                    settings.codebook.prepare(codebook.features, settings.seed, folder)


def _calibrate_scores(
    models: Mapping[int, ObjectModel],
    backgrounds: Backgrounds,
    partial: Path,
    record: LearntRecord,
) -> None:
    settings = record.settings
    frames = backgrounds.load_background_frames()
    learnt, find = LearntFolder(partial, record=record), FindSettings.of(settings)
    estimator = PoseEstimator(learnt, find, tuple(models))
    for object_id, model in models.items():
        with once(partial / OBJECTS / model.name, SCORED) as missing:
            if missing:
                scenes = settings.score.scenes
                score = calibrate_score(estimator, object_id, frames, scenes, settings.rendering)
                save_score_model(partial / OBJECTS / model.name, score)


def _views(
    models: Mapping[int, ObjectModel], partial: Path, settings: MethodSettings
) -> Callable[[int], Views]:
    """Views by object id: rendered once, then read from disk, so that few are held at a time."""

    def views_of(object_id: int) -> Views:
        folder = partial / VIEWS / str(object_id)
        with once(folder) as missing:
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
