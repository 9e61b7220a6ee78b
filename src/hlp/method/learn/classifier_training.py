"""Trains the holistic classifier on rendered windows and backgrounds."""

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import torch

from hlp.method.learn.model_files import CLASSIFIER, StartingWeights
from hlp.method.learn.training import calibration_images, fit, free_memory
from hlp.method.settings import ClassifierStage
from hlp.models.network_training import HolisticClassifier, copy_weights, raise_background
from hlp.models.onnx_export import export_network
from hlp.objects.distractors import distractor_scenes
from hlp.patches.backgrounds import Backgrounds
from hlp.patches.composite import BackgroundPool
from hlp.patches.holistic_data import HolisticDataModule
from hlp.patches.holistic_pool import HolisticPool, bake_backgrounds, bake_windows
from hlp.patches.sampling import join
from hlp.progress import Progress
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
    data = training_windows(models, views_of, backgrounds, settings)
    torch.manual_seed(settings.seed)
    channels = 4 if settings.holistic.channels == "rgbd" else 3
    module = HolisticClassifier(settings.classifier, channels, len(models) + 1)
    epochs = settings.classifier.epochs_for(len(data.pool["labels"]))
    if start is not None:
        copy_weights(module.network, start.weights, start.labels)
        epochs = start.epochs
    fit(module, data, module.network, epochs, settings.trainer, folder)
    free_memory()
    prior = max(settings.classifier.prior_objects or 0, len(models))
    pool = settings.pool
    raise_background(module.network, pool.object_odds(len(models)) / pool.object_odds(prior))
    sample, network = calibration_images(data, module.images), module.network
    del data, module
    free_memory()  # trainer, loader and data refer to each other: a gigabyte for 15 objects
    export_network(network, sample, folder / CLASSIFIER, levels=True)


def training_windows(
    models: Mapping[int, ObjectModel],
    views_of: Callable[[int], Views],
    backgrounds: Backgrounds,
    settings: ClassifierStage,
) -> HolisticDataModule:
    """The images that the classifier of all `models` is trained on."""
    ordered = [model for _, model in sorted(models.items())]
    windows = _windows(ordered, views_of, settings)
    return HolisticDataModule(
        windows,
        _backgrounds(ordered, backgrounds, len(windows.labels), settings),
        settings.holistic.channels,
        settings.pool.background_share_for(len(models)),
        settings.classifier.batch_size,
        settings.seed,
        settings.machine.threads,
    )


def _windows(
    models: Sequence[ObjectModel], views_of: Callable[[int], Views], settings: ClassifierStage
) -> HolisticPool:
    sizes, pools = [model.holistic_size for model in models], []
    of = sizes, settings.holistic.resolution, settings.pool
    for label, model in enumerate(Progress(models, "windows cut", unit="object"), 1):
        rng = np.random.default_rng([settings.seed, model.object_id])
        pools.append(bake_windows(views_of(model.object_id), model, label, *of, rng))
    return join(pools)


def _backgrounds(
    models: Sequence[ObjectModel], backgrounds: Backgrounds, windows: int, settings: ClassifierStage
) -> BackgroundPool:
    resolution, pool, seed = settings.holistic.resolution, settings.pool, settings.seed
    rng = np.random.default_rng([seed, 0])
    count = min(pool.backgrounds, windows)
    shown = -(-pool.distractor_scenes * count // pool.backgrounds)
    meshes, sizes = [m.mesh for m in models], [m.holistic_size for m in models]
    # The scenes are rendered while this thread makes or reads photographs.
    made = Progress(None, "backgrounds made", 3, unit="step")
    with made, ThreadPoolExecutor(1) as beside:
        threads = settings.machine.threads
        scenes = beside.submit(distractor_scenes, meshes, shown, seed, threads)
        crops = backgrounds.photograph_crops(count, resolution, rng)
        made.update()
        frames = [backgrounds.load_background_frames(), scenes.result()]
        made.update()
        return bake_backgrounds(crops, frames, sizes, resolution, count, rng)
