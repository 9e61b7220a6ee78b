"""Trains the encoder that the settings name."""

import gc
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
import torch

from hlp.method.backgrounds import Backgrounds
from hlp.method.networks import ENCODER, PCA
from hlp.method.settings import MethodSettings
from hlp.method.training import calibration_images, fit
from hlp.models.autoencoder import AutoencoderSettings
from hlp.models.autoencoder_training import Autoencoder
from hlp.models.contrastive import ContrastiveSettings
from hlp.models.contrastive_training import ContrastiveEncoder
from hlp.models.onnx_export import export_network
from hlp.models.pca import fit_pca
from hlp.patches.local_data import PairDataModule, PatchDataModule
from hlp.patches.local_pool import (
    PairPool,
    bake_frame_patches,
    bake_pairs,
    join_pairs,
    join_patches,
)
from hlp.records import ObjectModel, Views


def train_encoder(
    models: Mapping[int, ObjectModel],
    views_of: Callable[[int], Views],
    backgrounds: Backgrounds,
    settings: MethodSettings,
    folder: Path,
) -> None:
    """Train the encoder that the settings name into `folder`.

    The CAE sees RGB-D frames without the objects (paper, section 3.2), the others pairs of
    rendered patches. Raises ValueError where the CAE has no frames.
    """
    torch.manual_seed(settings.seed)
    encoder = settings.encoder
    if isinstance(encoder, AutoencoderSettings):
        _train_autoencoder(models, backgrounds, settings, encoder, folder)
    elif isinstance(encoder, ContrastiveSettings):
        pairs = _pairs(models, views_of, settings)
        with_color = encoder.input == "rgbd"
        data = PairDataModule(pairs, with_color, encoder.batch_size, settings.seed)
        module = ContrastiveEncoder(encoder)
        _fit(module, data, encoder.epochs, settings, folder)
    else:
        pairs = _pairs(models, views_of, settings)
        pca = fit_pca(pairs.depth[:, 0], pairs.valid[:, 0], encoder)
        np.savez(folder / PCA, mean=pca.mean, components=pca.components)
    gc.collect()  # as after the classifier


def _train_autoencoder(
    models: Mapping[int, ObjectModel],
    backgrounds: Backgrounds,
    settings: MethodSettings,
    encoder: AutoencoderSettings,
    folder: Path,
) -> None:
    frames = list(backgrounds.load_encoder_frames())
    sizes = sorted({model.local_size for model in models.values()})
    rng = np.random.default_rng(settings.seed)
    found = bake_frame_patches(frames, sizes, encoder.per_frame, settings.patches.local, rng)
    data = PatchDataModule(join_patches(found), encoder.batch_size, settings.seed)
    module = Autoencoder(encoder)
    _fit(module, data, encoder.epochs, settings, folder)


def _fit(
    module: Autoencoder | ContrastiveEncoder,
    data: PatchDataModule | PairDataModule,
    epochs: int,
    settings: MethodSettings,
    folder: Path,
) -> None:
    fit(module, data, module.network, epochs, settings.trainer, folder)
    sample = calibration_images(data, module.images)
    export_network(module.network.layers, sample, folder / ENCODER, levels=False)


def _pairs(
    models: Mapping[int, ObjectModel],
    views_of: Callable[[int], Views],
    settings: MethodSettings,
) -> PairPool:
    pools = []
    for object_id, model in sorted(models.items()):
        rng = np.random.default_rng([settings.seed, object_id])
        patches = settings.patches
        views = views_of(object_id)
        pools.append(bake_pairs(views, model.local_size, patches.local, patches.pairs, rng))
    return join_pairs(pools)
