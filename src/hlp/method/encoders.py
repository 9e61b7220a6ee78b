"""Trains the encoder that the configuration names, and loads it again."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import torch

from hlp.config.settings import RunSettings
from hlp.data.dataset import Dataset
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
from hlp.records import Views

_PCA = "pca.npz"


def train_encoder(
    dataset: Dataset, settings: RunSettings, views_of: Callable[[int], Views], folder: Path
) -> None:
    """Train the configured encoder into `folder`.

    The CAE sees RGB-D frames without the objects (paper, section 3.2), the others pairs of
    rendered patches. Raises ValueError where the CAE has no frames.
    """
    torch.manual_seed(settings.seed)
    encoder = settings.encoder
    if isinstance(encoder, AutoencoderSettings):
        _train_autoencoder(dataset, settings, encoder, folder)
    elif isinstance(encoder, ContrastiveSettings):
        pairs = _pairs(dataset, settings, views_of)
        with_color = encoder.input == "rgbd"
        data = PairDataModule(pairs, with_color, encoder.batch_size, settings.seed)
        module = ContrastiveEncoder(encoder)
        fit(module, data, module.network, encoder.epochs, settings.trainer, folder)
    else:
        pairs = _pairs(dataset, settings, views_of)
        depth = torch.from_numpy(pairs.depth[:, 0].astype(np.float32))
        pca = fit_pca(depth, torch.from_numpy(pairs.valid[:, 0]), encoder)
        np.savez(folder / _PCA, mean=pca.mean, components=pca.components)


def load_encoder(
    settings: ContrastiveSettings | AutoencoderSettings | PcaSettings, folder: Path, device: str
) -> Encoder:
    """The encoder that `train_encoder` left in `folder`; a network computes on the device."""
    if isinstance(settings, PcaSettings):
        with np.load(folder / _PCA) as stored:
            return PcaEncoder(stored["mean"], stored["components"], settings.cells)
    network = PatchEncoder(settings.widths, settings.dimension)
    load_weights(network, folder)
    return NetworkEncoder(
        network, settings.input, isinstance(settings, ContrastiveSettings), device
    )


def _train_autoencoder(
    dataset: Dataset, settings: RunSettings, encoder: AutoencoderSettings, folder: Path
) -> None:
    source = dataset.require_encoder_frames()
    sizes = sorted({model.local_size for model in dataset.models.values()})
    rng = np.random.default_rng(settings.seed)
    frames = [source.load(key) for key in source.keys]
    found = bake_frame_patches(frames, sizes, encoder.per_frame, settings.patches.local, rng)
    data = PatchDataModule(join_patches(found), encoder.batch_size, settings.seed)
    module = Autoencoder(encoder)
    fit(module, data, module.network, encoder.epochs, settings.trainer, folder)


def _pairs(dataset: Dataset, settings: RunSettings, views_of: Callable[[int], Views]) -> PairPool:
    pools = []
    for object_id, model in sorted(dataset.models.items()):
        rng = np.random.default_rng([settings.seed, object_id])
        patches = settings.patches
        views = views_of(object_id)
        pools.append(bake_pairs(views, model.local_size, patches.local, patches.pairs, rng))
    return join_pairs(pools)
