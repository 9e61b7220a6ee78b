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
from hlp.patches.pool_loader import batch_number, pool_loader
from hlp.records import LocalPatches

_FILL = 128.0 / 255.0
# Kinect-like: noise (m) at about a metre and the step of its disparity there.
_DEPTH_NOISE = 0.0025
_DEPTH_STEP = 0.003


class PairDataModule(pl.LightningDataModule):
    """Pairs for contrastive training: a patch as a camera would see it, and the clean one.

    A batch is a dictionary: `noisy` and `clean`, each (color (n, 3, p, p) in 0…1, depth and valid
    (n, p, p)); `object`, `point`, `rotation` to leave near neighbours out of the negatives.
    Colour is None unless `with_color`: it costs more than all else, and not every encoder sees it.
    """

    def __init__(self, pool: PairPool, with_color: bool, batch_size: int, seed: int) -> None:
        super().__init__()
        self.with_color = with_color
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
        """Degrade the first patch of each pair on the CPU, seeded by the batch's number."""
        gen = torch.Generator().manual_seed(self.seed * 1_000_003 + batch_number(self.trainer))
        depth, valid = batch["depth"].float(), batch["valid"]
        seen_depth, seen, around = degrade_shape(depth[:, 0], valid[:, 0], batch["size"], gen)
        noisy_color, clean_color = None, None
        if self.with_color:
            color = batch["color"].permute(0, 1, 4, 2, 3).float() / 255.0
            noisy_color = degrade_color(color[:, 0], seen, around, gen)
            clean_color = color[:, 1]
        return {
            "noisy": (noisy_color, seen_depth, seen),
            "clean": (clean_color, depth[:, 1], valid[:, 1]),
            "object": batch["object"],
            "point": batch["point"],
            "rotation": batch["rotation"],
        }


def degrade_shape(
    depth: Tensor, valid: Tensor, size: Tensor, gen: torch.Generator
) -> tuple[Tensor, Tensor, Tensor]:
    """What a camera in clutter makes of clean patches' depth.

    Surroundings appear within the metric cube (table, neighbours), occluders cover a part, the
    depth is noisy, quantised and has holes, the centre's depth (to which all is relative) errs.
    `size` (n,) in m; returns depth, valid and where the surroundings appeared.
    """
    n, p = len(depth), depth.shape[-1]
    half = size[:, None, None] / 2
    depth, around = _surroundings(depth, valid, gen)
    noise = aug.normal(gen, (n, p, p), 1.0) + aug.smooth_noise(gen, n, p, 8)
    level = aug.uniform(gen, (n, 1, 1), 0.2, 1.0) * _DEPTH_NOISE / half
    depth = depth + noise * level + aug.normal(gen, (n, 1, 1), 0.5) * level
    step = aug.uniform(gen, (n, 1, 1), 0.2, 1.0) * _DEPTH_STEP / half
    depth = torch.round(depth / step) * step
    occluder = aug.rectangles(gen, n, p, share=0.4, low=0.2, high=0.8)
    middle = slice(p // 2 - 2, p // 2 + 2)
    occluder &= ~occluder[:, middle, middle].any(dim=(1, 2))[:, None, None]
    holes = aug.smooth_noise(gen, n, p, 8) > aug.uniform(gen, (n, 1, 1), 1.2, 4.0)
    valid = (valid | around) & ~occluder & ~holes & (depth.abs() <= 1.0)
    return torch.where(valid, depth, torch.ones(())), valid, around


def degrade_color(color: Tensor, valid: Tensor, around: Tensor, gen: torch.Generator) -> Tensor:
    """What light and a camera make of clean patches' colour (n, 3, p, p), 0…1.

    `valid` and `around` (n, p, p) are `degrade_shape`'s.
    """
    paint = _paint(len(color), color.shape[-1], gen)
    color = torch.where(around[:, None], paint, aug.vary_surface(color, gen))
    return torch.where(valid[:, None], aug.vary_camera(color, gen), torch.tensor(_FILL))


def _surroundings(depth: Tensor, valid: Tensor, gen: torch.Generator) -> tuple[Tensor, Tensor]:
    """Fill part of the void with slanted planes, as a table or a neighbour would; depth, where."""
    n, p = len(depth), depth.shape[-1]
    plane = aug.random_planes(gen, n, p, -0.3, 1.2)
    plane = plane + aug.smooth_noise(gen, n, p, 4) * aug.uniform(gen, (n, 1, 1), 0.0, 0.2)
    drawn = torch.rand((n, 1, 1), generator=gen) < 0.7
    shown = ~valid & drawn & (plane.abs() <= 1.0)
    return torch.where(shown, plane, depth), shown


def _paint(n: int, p: int, gen: torch.Generator) -> Tensor:
    """Colours (n, 3, p, p) of what surrounds the objects."""
    tint = aug.uniform(gen, (n, 3, 1, 1), 0.0, 1.0)
    texture = torch.randn((n, 3, 4, 4), generator=gen) * aug.uniform(gen, (n, 1, 1, 1), 0.0, 0.3)
    return tint + functional.interpolate(texture, size=(p, p), mode="bilinear")


def degrade_patches(
    patches: LocalPatches, rows: Int[np.ndarray, "m"], size: float, seed: int
) -> LocalPatches:
    """Chosen patches of metric `size` (m) as a camera in clutter would see them."""
    chosen = take_patches(patches, rows)
    gen = torch.Generator().manual_seed(seed)
    clean = torch.from_numpy(chosen.color).permute(0, 3, 1, 2).float() / 255.0
    sizes = torch.full((len(chosen),), size)
    depth, valid, around = degrade_shape(
        torch.from_numpy(chosen.depth), torch.from_numpy(chosen.valid), sizes, gen
    )
    color = degrade_color(clean, valid, around, gen)
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
