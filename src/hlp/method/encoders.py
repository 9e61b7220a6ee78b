"""Trains the encoder that the settings name, and loads it again."""

import gc
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
import torch

from hlp.method.backgrounds import Backgrounds
from hlp.method.settings import EncoderSettings, MethodSettings
from hlp.method.training import fit, load_weights
from hlp.models.autoencoder import Autoencoder, AutoencoderSettings
from hlp.models.contrastive import ContrastiveEncoder, ContrastiveSettings
from hlp.models.encoder import Encoder, NetworkEncoder, PatchEncoder
from hlp.models.pca import PcaEncoder, PcaSettings, fit_pca
from hlp.patches.local_data import PairDataModule, PatchDataModule
from hlp.patches.local_pool import (
    PairPool,
    bake_frame_patches,
    bake_pairs,
    join_pairs,
    join_patches,
)
from hlp.records import ObjectModel, Views

_PCA = "pca.npz"


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
        fit(module, data, module.network, encoder.epochs, settings.trainer, folder)
    else:
        pairs = _pairs(models, views_of, settings)
        depth = torch.from_numpy(pairs.depth[:, 0].astype(np.float32))
        pca = fit_pca(depth, torch.from_numpy(pairs.valid[:, 0]), encoder)
        np.savez(folder / _PCA, mean=pca.mean, components=pca.components)
    gc.collect()  # as after the classifier


def load_encoder(settings: EncoderSettings, folder: Path, device: str) -> Encoder:
    """The encoder that `train_encoder` left in `folder`; a network runs on the device."""
    if isinstance(settings, PcaSettings):
        with np.load(folder / _PCA) as stored:
            return PcaEncoder(stored["mean"], stored["components"], settings.cells)
    network = PatchEncoder(settings.widths, settings.dimension)
    load_weights(network, folder)
    return NetworkEncoder(
        network, settings.input, isinstance(settings, ContrastiveSettings), device
    )


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
    fit(module, data, module.network, encoder.epochs, settings.trainer, folder)


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
