"""Trains the encoder that the settings name."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytorch_lightning as pl
import torch

from hlp.arrays import DepthPatches, MaskPatches
from hlp.method.learn.training import calibration_images, fit, free_memory
from hlp.method.settings import EncoderStage
from hlp.models.encoder import STEM
from hlp.models.network_training import OneCycleModule
from hlp.models.onnx_export import export_network
from hlp.patches.backgrounds import Backgrounds
from hlp.patches.local_data import PairDataModule, PatchDataModule
from hlp.patches.local_pool import PairPool, bake_frame_patches, bake_pairs
from hlp.patches.sampling import join
from hlp.progress import Progress
from hlp.records import ObjectModel, Views


def train_encoder(
    models: Mapping[int, ObjectModel],
    views_of: Callable[[int], Views],
    backgrounds: Backgrounds,
    settings: EncoderStage,
    folder: Path,
) -> None:
    """Train the encoder that the settings name into `folder`.

    The CAE is trained on RGB-D frames without the objects (paper, section 3.2), the others on
    rendered patches. Raises ValueError if an encoder needs frames and there are none.
    """
    torch.manual_seed(settings.seed)
    settings.encoder.train(_Training(models, views_of, backgrounds, settings, folder))
    free_memory()  # as after the classifier


@dataclass(frozen=True)
class _Training:
    """What encoders train with (`hlp.models.encoder.EncoderTraining`)."""

    models: Mapping[int, ObjectModel]
    views_of: Callable[[int], Views]
    backgrounds: Backgrounds
    settings: EncoderStage
    folder: Path

    def pair_batches(self, with_color: bool, batch_size: int) -> pl.LightningDataModule:
        return PairDataModule(self._pairs(with_color), with_color, batch_size, self.settings.seed)

    def pair_patches(self) -> tuple[DepthPatches, MaskPatches]:
        pairs = self._pairs(with_color=False)
        return pairs.depth[:, 0], pairs.valid[:, 0]

    def frame_batches(
        self, per_frame: int, batch_size: int, rooms: bool, varied_light: bool
    ) -> pl.LightningDataModule:
        frames = list(self.backgrounds.load_encoder_frames())
        if rooms:
            frames += self.backgrounds.load_background_frames()
        local = self.settings.local
        sizes = sorted({local.side_of(model.local_size) for model in self.models.values()})
        rng = np.random.default_rng(self.settings.seed)
        patches = join(bake_frame_patches(frames, sizes, per_frame, local, rng))
        return PatchDataModule(patches, batch_size, self.settings.seed, varied_light)

    def fit(self, module: OneCycleModule, data: pl.LightningDataModule, epochs: int) -> None:
        fit(module, data, module.network, epochs, self.settings.trainer, self.folder)
        sample = calibration_images(data, module.images)
        export_network(module.network, sample, self.folder / STEM, levels=False)

    def _pairs(self, with_color: bool) -> PairPool:
        settings, pools = self.settings, []
        models = sorted(self.models.items())
        for object_id, model in Progress(models, "pairs cut", unit="object"):
            rng, views = np.random.default_rng([settings.seed, object_id]), self.views_of(object_id)
            size = settings.local.side_of(model.local_size)
            pools.append(bake_pairs(views, size, settings.local, settings.pairs, rng, with_color))
        return join(pools)
