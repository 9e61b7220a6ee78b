"""Batches for the local encoders: sensor noise, clutter and occluders on clean pairs."""

import numpy as np
import pytorch_lightning as pl
import torch
from jaxtyping import Int
from torch import Tensor
from torch.nn import functional
from torch.utils.data import DataLoader

from hlp.patches import augmentation as aug
from hlp.patches.local_pool import PairPool, take_patches
from hlp.patches.pool_loader import pool_loader
from hlp.records import LocalPatches

_FILL = 128.0 / 255.0
# Kinect-like: noise (m) at about a metre and the step of its disparity there.
_DEPTH_NOISE = 0.0025
_DEPTH_STEP = 0.003


class PairDataModule(pl.LightningDataModule):
    """Pairs for contrastive training: a patch as a camera would see it, and the clean one.

    A batch is a dictionary: `noisy` and `clean`, each (color (n, 3, p, p) in 0…1, depth and valid
    (n, p, p)); `object`, `point`, `rotation` to leave near neighbours out of the negatives.
    """

    def __init__(self, pool: PairPool, batch_size: int, seed: int) -> None:
        super().__init__()
        self.pool = {
            "color": torch.from_numpy(pool.color),
            "depth": torch.from_numpy(pool.depth),
            "valid": torch.from_numpy(pool.valid),
            "size": torch.from_numpy(pool.sizes),
            "object": torch.from_numpy(pool.object_ids),
            "point": torch.from_numpy(pool.points_obj),
            "rotation": torch.from_numpy(pool.rotations),
        }
        self.batch_size = batch_size
        self.seed = seed

    def train_dataloader(self) -> DataLoader[dict[str, Tensor]]:
        """Batches in an order that depends on seed and epoch only."""
        return pool_loader(self.pool, self.batch_size, self.seed)

    def on_before_batch_transfer(
        self, batch: dict[str, Tensor], dataloader_idx: int
    ) -> dict[str, object]:
        """Degrade the first patch of each pair on the CPU, seeded by the trainer's step."""
        step = self.trainer.global_step if self.trainer is not None else 0
        gen = torch.Generator().manual_seed(self.seed * 1_000_003 + step)
        color = batch["color"].permute(0, 1, 4, 2, 3).float() / 255.0
        depth, valid = batch["depth"].float(), batch["valid"]
        noisy = degrade(color[:, 0], depth[:, 0], valid[:, 0], batch["size"], gen)
        return {
            "noisy": noisy,
            "clean": (color[:, 1], depth[:, 1], valid[:, 1]),
            "object": batch["object"],
            "point": batch["point"],
            "rotation": batch["rotation"],
        }


def degrade(
    color: Tensor, depth: Tensor, valid: Tensor, size: Tensor, gen: torch.Generator
) -> tuple[Tensor, Tensor, Tensor]:
    """What a camera in clutter makes of clean patches.

    Surroundings appear within the metric cube (table, neighbours), occluders cover a part, the
    depth is noisy, quantised and has holes, the centre's depth (to which all is relative) errs,
    and light and colour differ. `size` (n,) in m; returns colour, depth, valid.
    """
    n, p = len(depth), depth.shape[-1]
    half = size[:, None, None] / 2
    color = aug.vary_surface(color, gen)
    depth, color, valid = _surroundings(depth, color, valid, gen)
    noise = aug.normal(gen, (n, p, p), 1.0) + aug.smooth_noise(gen, n, p, 8)
    level = aug.uniform(gen, (n, 1, 1), 0.2, 1.0) * _DEPTH_NOISE / half
    depth = depth + noise * level + aug.normal(gen, (n, 1, 1), 0.5) * level
    step = aug.uniform(gen, (n, 1, 1), 0.2, 1.0) * _DEPTH_STEP / half
    depth = torch.round(depth / step) * step
    occluder = aug.rectangles(gen, n, p, share=0.4, low=0.2, high=0.8)
    middle = slice(p // 2 - 2, p // 2 + 2)
    occluder &= ~occluder[:, middle, middle].any(dim=(1, 2))[:, None, None]
    holes = aug.smooth_noise(gen, n, p, 8) > aug.uniform(gen, (n, 1, 1), 1.2, 4.0)
    valid = valid & ~occluder & ~holes & (depth.abs() <= 1.0)
    color = aug.vary_camera(color, gen)
    fill = torch.full_like(color, _FILL)
    color = torch.where(valid[:, None], color, fill)
    return color, torch.where(valid, depth, torch.ones(())), valid


def _surroundings(
    depth: Tensor, color: Tensor, valid: Tensor, gen: torch.Generator
) -> tuple[Tensor, Tensor, Tensor]:
    """Fill part of the void with slanted coloured planes, as a table or a neighbour would."""
    n, p = len(depth), depth.shape[-1]
    plane = aug.random_planes(gen, n, p, -0.3, 1.2)
    plane = plane + aug.smooth_noise(gen, n, p, 4) * aug.uniform(gen, (n, 1, 1), 0.0, 0.2)
    drawn = torch.rand((n, 1, 1), generator=gen) < 0.7
    shown = ~valid & drawn & (plane.abs() <= 1.0)
    tint = aug.uniform(gen, (n, 3, 1, 1), 0.0, 1.0)
    texture = torch.randn((n, 3, 4, 4), generator=gen) * aug.uniform(gen, (n, 1, 1, 1), 0.0, 0.3)
    paint = tint + functional.interpolate(texture, size=(p, p), mode="bilinear")
    return (
        torch.where(shown, plane, depth),
        torch.where(shown[:, None], paint, color),
        valid | shown,
    )


def degrade_patches(
    patches: LocalPatches, rows: Int[np.ndarray, "m"], size: float, seed: int
) -> LocalPatches:
    """Chosen patches of metric `size` (m) as a camera in clutter would see them."""
    chosen = take_patches(patches, rows)
    color, depth, valid = degrade(
        torch.from_numpy(chosen.color).permute(0, 3, 1, 2).float() / 255.0,
        torch.from_numpy(chosen.depth),
        torch.from_numpy(chosen.valid),
        torch.full((len(chosen),), size),
        torch.Generator().manual_seed(seed),
    )
    rgb = (color.permute(0, 2, 3, 1) * 255.0).round().to(torch.uint8).numpy()
    return LocalPatches(rgb, depth.numpy(), valid.numpy(), chosen.points_cam, chosen.pixels)


class PatchDataModule(pl.LightningDataModule):
    """Local patches as they are, for the autoencoder: `color`, `depth`, `valid`."""

    def __init__(self, patches: LocalPatches, batch_size: int, seed: int) -> None:
        super().__init__()
        self.pool = {
            "color": torch.from_numpy(patches.color),
            "depth": torch.from_numpy(patches.depth),
            "valid": torch.from_numpy(patches.valid),
        }
        self.batch_size = batch_size
        self.seed = seed

    def train_dataloader(self) -> DataLoader[dict[str, Tensor]]:
        """Batches in an order that depends on seed and epoch only."""
        return pool_loader(self.pool, self.batch_size, self.seed)
