"""Batches for the local encoders: pairs of a clean patch and one with noise and clutter."""

import numpy as np
import pytorch_lightning as pl
import torch
from jaxtyping import Int
from torch import Tensor
from torch.nn import functional
from torch.utils.data import DataLoader

from hlp.patches import augmentation as aug
from hlp.patches.local import take_patches
from hlp.patches.local_pool import PairPool
from hlp.patches.pool_loader import batch_number, pool_loader
from hlp.records import LocalPatches

_FILL = 128.0 / 255.0
# Like a Kinect at about one metre: noise and quantisation of depth (m).
_DEPTH_NOISE = 0.0025
_DEPTH_STEP = 0.003


class PairDataModule(pl.LightningDataModule):
    """Pairs for contrastive training: a patch as a camera would see it, and a clean one.

    A batch is a dictionary. `noisy` and `clean` are triples of color (n, 3, p, p) in 0…1, depth and
    valid (n, p, p). `object`, `point` and `rotation` serve to exclude near neighbours from the
    negatives. Colour is None unless `with_color`: it takes most of the time, and not every encoder
    uses it.
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
        seen_depth, seen, clutter = degrade_depth(depth[:, 0], valid[:, 0], batch["size"], gen)
        noisy_color, clean_color = None, None
        if self.with_color:
            color = batch["color"].permute(0, 1, 4, 2, 3).float() / 255.0
            noisy_color = degrade_color(color[:, 0], seen, clutter, gen)
            clean_color = color[:, 1]
        return {
            "noisy": (noisy_color, seen_depth, seen),
            "clean": (clean_color, depth[:, 1], valid[:, 1]),
            "object": batch["object"],
            "point": batch["point"],
            "rotation": batch["rotation"],
        }


def degrade_depth(
    depth: Tensor, valid: Tensor, size: Tensor, gen: torch.Generator
) -> tuple[Tensor, Tensor, Tensor]:
    """Depth (n, p, p) of clean patches as a camera in clutter would measure it.

    Surroundings such as a table appear inside the metric cube, occluders cover a part, depth is
    noisy and quantised and has holes, and the centre's depth, to which all is relative, has an
    error. `size` (n,) is in m. Returns depth, valid, and where clutter was added.
    """
    n, p = len(depth), depth.shape[-1]
    half = size[:, None, None] / 2
    depth, clutter = _add_clutter(depth, valid, gen)
    noise = aug.normal(gen, (n, p, p), 1.0) + aug.smooth_noise(gen, n, p, 8)
    level = aug.uniform(gen, (n, 1, 1), 0.2, 1.0) * _DEPTH_NOISE / half
    depth = depth + noise * level + aug.normal(gen, (n, 1, 1), 0.5) * level
    step = aug.uniform(gen, (n, 1, 1), 0.2, 1.0) * _DEPTH_STEP / half
    depth = torch.round(depth / step) * step
    occluder = aug.rectangles(gen, n, p, share=0.4, low=0.2, high=0.8)
    middle = slice(p // 2 - 2, p // 2 + 2)
    occluder &= ~occluder[:, middle, middle].any(dim=(1, 2))[:, None, None]
    holes = aug.smooth_noise(gen, n, p, 8) > aug.uniform(gen, (n, 1, 1), 1.2, 4.0)
    valid = (valid | clutter) & ~occluder & ~holes & (depth.abs() <= 1.0)
    return torch.where(valid, depth, torch.ones(())), valid, clutter


def degrade_color(color: Tensor, valid: Tensor, clutter: Tensor, gen: torch.Generator) -> Tensor:
    """Colour (n, 3, p, p) in 0…1 of clean patches under another light, as a camera sees it.

    `valid` and `clutter` (n, p, p) are results of `degrade_depth`.
    """
    paint = _clutter_colors(len(color), color.shape[-1], gen)
    color = torch.where(clutter[:, None], paint, aug.vary_surface(color, gen))
    return torch.where(valid[:, None], aug.vary_camera(color, gen), torch.tensor(_FILL))


def _add_clutter(depth: Tensor, valid: Tensor, gen: torch.Generator) -> tuple[Tensor, Tensor]:
    """Fill invalid pixels with slanted planes, like a table or a neighbour; depth and where."""
    n, p = len(depth), depth.shape[-1]
    plane = aug.random_planes(gen, n, p, -0.3, 1.2)
    plane = plane + aug.smooth_noise(gen, n, p, 4) * aug.uniform(gen, (n, 1, 1), 0.0, 0.2)
    drawn = torch.rand((n, 1, 1), generator=gen) < 0.7
    shown = ~valid & drawn & (plane.abs() <= 1.0)
    return torch.where(shown, plane, depth), shown


def _clutter_colors(n: int, p: int, gen: torch.Generator) -> Tensor:
    """Random colours (n, 3, p, p) of clutter."""
    tint = aug.uniform(gen, (n, 3, 1, 1), 0.0, 1.0)
    texture = torch.randn((n, 3, 4, 4), generator=gen) * aug.uniform(gen, (n, 1, 1, 1), 0.0, 0.3)
    return tint + functional.interpolate(texture, size=(p, p), mode="bilinear")


def degrade_patches(
    patches: LocalPatches, rows: Int[np.ndarray, "m"], size: float, seed: int
) -> LocalPatches:
    """The patches of some rows, of metric `size` (m), as a camera in clutter would see them.

    Patches without colour channels stay without.
    """
    chosen = take_patches(patches, rows)
    gen = torch.Generator().manual_seed(seed)
    sizes = torch.full((len(chosen),), size)
    depth, valid, clutter = degrade_depth(
        torch.from_numpy(chosen.depth), torch.from_numpy(chosen.valid), sizes, gen
    )
    rgb = chosen.color
    if rgb.shape[-1]:
        clean = torch.from_numpy(rgb).permute(0, 3, 1, 2).float() / 255.0
        color = degrade_color(clean, valid, clutter, gen)
        rgb = (color.permute(0, 2, 3, 1) * 255.0).round().to(torch.uint8).numpy()
    return LocalPatches(rgb, depth.numpy(), valid.numpy(), chosen.points_cam, chosen.pixels)


class PatchDataModule(pl.LightningDataModule):
    """Local patches for the autoencoder: `color`, `depth`, `valid`, as they were cut.

    With `varied_light` a batch also holds `seen`: the colour (n, 3, p, p) in 0…1 as a camera would
    see it under another light.
    """

    def __init__(
        self, patches: LocalPatches, batch_size: int, seed: int, varied_light: bool = False
    ) -> None:
        super().__init__()
        self.varied_light = varied_light
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

    def on_before_batch_transfer(
        self, batch: dict[str, Tensor], dataloader_idx: int
    ) -> dict[str, Tensor]:
        """Vary the light on the CPU, seeded by the batch's number."""
        if not self.varied_light:
            return batch
        gen = torch.Generator().manual_seed(self.seed * 1_000_003 + batch_number(self.trainer))
        color = batch["color"].permute(0, 3, 1, 2).float() / 255.0
        return {**batch, "seen": aug.vary_camera(aug.vary_surface(color, gen), gen)}
