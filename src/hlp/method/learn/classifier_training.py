"""Trains the holistic classifier on rendered windows and backgrounds."""

import gc
import logging
from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import torch

from hlp.method.learn.backgrounds import Backgrounds
from hlp.method.learn.checkpoints import StartingWeights
from hlp.method.learn.model_files import CLASSIFIER
from hlp.method.learn.training import calibration_images, fit
from hlp.method.stage_settings import ClassifierStage
from hlp.models.classifier_training import HolisticClassifier, copy_weights, raise_background
from hlp.models.onnx_export import export_network
from hlp.objects.distractors import distractor_scenes
from hlp.patches.holistic_data import HolisticDataModule
from hlp.patches.holistic_pool import (
    BackgroundPool,
    HolisticPool,
    bake_backgrounds,
    bake_windows,
    join_pools,
)
from hlp.records import ObjectModel, Views


def train_classifier(
    models: Mapping[int, ObjectModel],
    views_of: Callable[[int], Views],
    backgrounds: Backgrounds,
    settings: ClassifierStage,
    folder: Path,
    start: StartingWeights | None = None,
) -> None:
    """Train the classifier of all `models` into `folder` (paper, section 3.1, Fig. 3).

    Class i is the i-th object by id, 0 is background. An interrupted training continues from
    the last checkpoint in `folder`.
    """
    logging.getLogger(__name__).info("cutting windows of %d objects", len(models))
    data = training_windows(models, views_of, backgrounds, settings)
    torch.manual_seed(settings.seed)
    module = HolisticClassifier(settings.classifier, _channels(settings), len(models) + 1)
    epochs = settings.classifier.epochs_for(len(data.pool["label"]))
    if start is not None:
        copy_weights(module.network, start.weights, start.labels)
        epochs = start.epochs
    fit(module, data, module.network, epochs, settings.trainer, folder)
    prior = max(settings.classifier.prior_objects, len(models))
    pool = settings.pool
    raise_background(module.network, pool.object_odds(len(models)) / pool.object_odds(prior))
    sample = calibration_images(data, module.images)
    export_network(module.network.layers, sample, folder / CLASSIFIER, levels=True)
    del data, module
    gc.collect()  # trainer, loader and data refer to each other: a gigabyte for 15 objects


def training_windows(
    models: Mapping[int, ObjectModel],
    views_of: Callable[[int], Views],
    backgrounds: Backgrounds,
    settings: ClassifierStage,
) -> HolisticDataModule:
    """The images that the classifier of all `models` is trained on."""
    return HolisticDataModule(
        _windows(models, views_of, settings),
        _backgrounds(models, backgrounds, settings),
        settings.holistic.channels,
        settings.pool.background_share_for(len(models)),
        settings.classifier.batch_size,
        settings.seed,
        settings.machine.threads,
    )


def _channels(settings: ClassifierStage) -> int:
    return 4 if settings.holistic.channels == "rgbd" else 3


def _sizes(models: Mapping[int, ObjectModel]) -> list[float]:
    return [model.holistic_size for _, model in sorted(models.items())]


def _windows(
    models: Mapping[int, ObjectModel],
    views_of: Callable[[int], Views],
    settings: ClassifierStage,
) -> HolisticPool:
    pools = []
    for label, (object_id, model) in enumerate(sorted(models.items()), start=1):
        pool = bake_windows(
            views_of(object_id),
            label,
            model.holistic_size,
            _sizes(models),
            model.centroid,
            settings.holistic.resolution,
            settings.pool,
            np.random.default_rng([settings.seed, object_id]),
            model.mesh.colored,
        )
        pools.append(pool)
    return join_pools(pools)


def _backgrounds(
    models: Mapping[int, ObjectModel], backgrounds: Backgrounds, settings: ClassifierStage
) -> BackgroundPool:
    resolution, pool = settings.holistic.resolution, settings.pool
    rng = np.random.default_rng([settings.seed, 0])
    meshes = [model.mesh for _, model in sorted(models.items())]
    # The scenes are rendered while this thread makes or reads photographs.
    with ThreadPoolExecutor(1) as beside:
        scenes = beside.submit(
            distractor_scenes,
            meshes,
            pool.distractor_scenes,
            settings.seed,
            settings.machine.threads,
        )
        crops = backgrounds.photograph_crops(pool.backgrounds, resolution, rng)
        frames = [backgrounds.load_background_frames(), scenes.result()]
    return bake_backgrounds(crops, frames, _sizes(models), resolution, pool.backgrounds, rng)
