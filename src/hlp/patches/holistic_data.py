"""Batches for the holistic classifier: composites on backgrounds, then augmentation."""

from dataclasses import dataclass

import numpy as np
import pytorch_lightning as pl
import torch
from jaxtyping import UInt8
from torch import Tensor
from torch.utils.data import DataLoader

from hlp.patches import augmentation as aug
from hlp.patches.holistic_pool import BACKGROUND, BackgroundPool, HolisticPool
from hlp.patches.pool_loader import pool_loader


@dataclass(frozen=True)
class _Backdrop:
    color: Tensor
    depth: Tensor


class HolisticDataModule(pl.LightningDataModule):
    """Composites of baked windows on backgrounds.

    A batch is a pair of images (n, c, p, p) in [-1, 1], c = 3 (`rgb`) or 4 (`rgbd`), and labels.
    The same seed, epoch and step give the same batch, whatever ran before.
    """

    def __init__(
        self,
        pool: HolisticPool,
        backgrounds: BackgroundPool,
        channels: str,
        background_share: float,
        batch_size: int,
        seed: int,
    ) -> None:
        super().__init__()
        self.pool = {
            "color": torch.from_numpy(pool.color),
            "depth": torch.from_numpy(pool.depth),
            "mask": torch.from_numpy(pool.mask),
            "label": torch.from_numpy(pool.labels),
        }
        self.backgrounds = _Backdrop(
            torch.from_numpy(backgrounds.color), torch.from_numpy(backgrounds.depth)
        )
        self.channels = channels
        self.background_share = background_share
        self.batch_size = batch_size
        self.seed = seed

    def train_dataloader(self) -> DataLoader[dict[str, Tensor]]:
        """Batches in an order that depends on seed and epoch only."""
        return pool_loader(self.pool, self.batch_size, self.seed)

    def on_before_batch_transfer(
        self, batch: dict[str, Tensor], dataloader_idx: int
    ) -> tuple[Tensor, Tensor]:
        """Composite and augment on the CPU, seeded by the trainer's step."""
        step = self.trainer.global_step if self.trainer is not None else 0
        gen = torch.Generator().manual_seed(self.seed * 1_000_003 + step)
        return self.compose(batch, gen)

    def compose(self, batch: dict[str, Tensor], gen: torch.Generator) -> tuple[Tensor, Tensor]:
        """Images and labels of one batch of baked windows."""
        labels = batch["label"].clone()
        mask = batch["mask"]
        n, size = len(labels), mask.shape[-1]
        alone = torch.rand(n, generator=gen) < self.background_share
        labels[alone] = BACKGROUND
        occluder = aug.rectangles(gen, n, size, share=1 / 3, low=0.15, high=0.6)
        # An occluder over the centre would set another depth, hence another window.
        middle = slice(size // 2 - 3, size // 2 + 3)
        occluder &= ~occluder[:, middle, middle].any(dim=(1, 2))[:, None, None]
        shown = mask & ~alone[:, None, None] & ~occluder
        behind = self._draw_backgrounds(n, gen)
        surface = aug.vary_surface(_unit(batch["color"]), gen)
        # Another sample's background serves as occluder: as random, and already there.
        color = torch.where(occluder[:, None], behind.color.roll(1, dims=0), behind.color)
        color = torch.where(shown[:, None], surface, color)
        color = aug.vary_camera(color, gen) * 2 - 1
        if self.channels == "rgb":
            return color.contiguous(memory_format=torch.channels_last), labels
        depth = self._depth(batch["depth"], shown, occluder, behind.depth, gen)
        image = torch.cat([color, depth[:, None]], dim=1)
        return image.contiguous(memory_format=torch.channels_last), labels

    def _draw_backgrounds(self, n: int, gen: torch.Generator) -> _Backdrop:
        rows = torch.randint(len(self.backgrounds.color), (n,), generator=gen)
        color = _unit(self.backgrounds.color[rows])
        gain = torch.exp(aug.uniform(gen, (n, 1, 1, 1), -0.4, 0.3))
        size = color.shape[-1]
        code = self.backgrounds.depth[rows]
        plane = aug.random_planes(gen, n, size, -0.2, 1.2)
        plane = plane + aug.smooth_noise(gen, n, size, 4) * aug.uniform(gen, (n, 1, 1), 0, 0.4)
        measured = (code > 0).flatten(1).any(dim=1)[:, None, None]
        return _Backdrop(color * gain, torch.where(measured, code_to_unit(code), plane))

    def _depth(
        self,
        code: Tensor,
        shown: Tensor,
        occluder: Tensor,
        behind: Tensor,
        gen: torch.Generator,
    ) -> Tensor:
        """Depth of the composite in [-1, 1]: noise, steps of quantisation, holes."""
        n, size = len(code), code.shape[-1]
        away = aug.uniform(gen, (n, 1, 1), 0.0, 0.6)
        depth = torch.where(shown, code_to_unit(code), behind + away)
        near = aug.random_planes(gen, n, size, -0.8, -0.1)
        depth = torch.where(occluder, near, depth)
        depth = depth + aug.normal(gen, (n, 1, 1), 0.02)
        depth = depth + aug.normal(gen, (n, size, size), 1.0) * aug.uniform(gen, (n, 1, 1), 0, 0.03)
        holes = aug.smooth_noise(gen, n, size, 16) > aug.uniform(gen, (n, 1, 1), 1.2, 4.0)
        return torch.where(holes, torch.ones(()), depth.clamp(-1.0, 1.0))


def window_images(
    color: UInt8[np.ndarray, "n p p 3"], code: UInt8[np.ndarray, "n p p"], channels: str
) -> Tensor:
    """Images (n, c, p, p) in [-1, 1] of a scene's windows, as the classifier was trained on."""
    image = _unit(torch.from_numpy(color)) * 2 - 1
    if channels == "rgb":
        return image
    return torch.cat([image, code_to_unit(torch.from_numpy(code))[:, None]], dim=1)


def code_to_unit(code: Tensor) -> Tensor:
    """Depth codes 1 … 255 (`hlp.patches.holistic.depth_code`) to [-1, 1]."""
    return (code.float() - 128.0) / 127.0


def _unit(color: Tensor) -> Tensor:
    return color.permute(0, 3, 1, 2).float() / 255.0
