"""Batches for the holistic classifier: windows composed with random backgrounds and effects."""

import numpy as np
import torch
from torch import Tensor

from hlp.patches.composite import (
    COMPOSITE_DRAWS,
    NOISE_LENGTH,
    BackgroundPool,
    ObjectWindows,
    compose_windows,
)
from hlp.patches.holistic_pool import BACKGROUND, HolisticPool
from hlp.patches.pool_loader import Batch, PoolDataModule

_CUT_OFF = 0.05  # share of the windows beyond the image's border vertically, or horizontally (D)


class HolisticDataModule(PoolDataModule):
    """Composites of pooled windows and backgrounds.

    A batch is a pair: images (n, c, p, p) in [-1, 1] with c = 3 (`rgb`) or 4 (`rgbd`), and labels
    (n,). It depends on seed, epoch and step only, whatever the earlier batches and `threads`.
    """

    def __init__(
        self,
        pool: HolisticPool,
        backgrounds: BackgroundPool,
        channels: str,
        background_share: float,
        batch_size: int,
        seed: int,
        threads: int,
    ) -> None:
        super().__init__(vars(pool), batch_size, seed)
        self.backgrounds = backgrounds
        self.channels = channels
        self.background_share = background_share
        self.threads = threads
        self._noise = np.random.default_rng(seed).standard_normal(NOISE_LENGTH, dtype=np.float32)

    def on_before_batch_transfer(self, batch: Batch, dataloader_idx: int) -> tuple[Tensor, Tensor]:
        """Compose the batch on the CPU, seeded by its number."""
        return self.compose(batch, np.random.default_rng([self.seed, self.batch_number]))

    def compose(self, batch: Batch, rng: np.random.Generator) -> tuple[Tensor, Tensor]:
        """Images and labels of one batch of pooled windows."""
        count, size = batch["mask"].shape[:2]
        behind, with_depth = self.backgrounds, self.channels == "rgbd"
        draws = draw_composites(rng, count, size, len(behind.color), self.background_share)
        windows = ObjectWindows(*(batch[name].numpy() for name in ("color", "depth", "mask")))
        images = compose_windows(windows, behind, draws, self._noise, with_depth, self.threads)
        labels = batch["labels"].clone()
        labels[torch.from_numpy(draws["background_only"].copy())] = BACKGROUND
        # A view: channels stay last in memory, which the network is fastest with.
        return torch.from_numpy(images).permute(0, 3, 1, 2), labels


def draw_composites(
    rng: np.random.Generator, count: int, size: int, backgrounds: int, background_share: float
) -> np.ndarray:
    """Random numbers (type COMPOSITE_DRAWS) for `count` images of `size` px.

    Random white balance, exposure, blur, noise, occluders, borders and backgrounds let a network
    that is trained on renderings work on real images. Light is random in the rendered views
    already.
    """
    draws = np.zeros(count, COMPOSITE_DRAWS)
    draws["background_only"] = rng.random(count) < background_share
    _draw_occluders(rng, draws, size)
    draws["background"] = rng.integers(backgrounds, size=count)
    draws["background_gain"] = np.exp(rng.uniform(-0.4, 0.3, count))
    # The background of another image is the occluder's texture.
    draws["occluder"] = np.roll(draws["background"], 1)
    draws["occluder_gain"] = np.roll(draws["background_gain"], 1)
    _draw_colors(rng, draws)
    _draw_depths(rng, draws)
    _center_backgrounds(draws)
    draws["noise_start"] = rng.integers(NOISE_LENGTH - 4 * size * size, size=count)
    _draw_borders(rng, draws, size)
    return draws


def _center_backgrounds(draws: np.ndarray) -> None:
    """Give images of background alone the depth that their windows have in the middle: 0.

    A background lies behind an object at any distance. Alone it is what the window's size was taken
    from; if it were elsewhere, the depth in the middle would tell an object from anything else.
    """
    alone = draws["background_only"]
    draws["background_offset"][alone] = 0.0
    draws["background_plane"][alone, 0] = 0.0
    middle = draws["background_heights"][:, 1:3, 1:3].mean(axis=(1, 2), keepdims=True)
    draws["background_heights"] -= np.where(alone[:, None, None], middle, np.float32(0.0))


def _draw_occluders(rng: np.random.Generator, draws: np.ndarray, size: int) -> None:
    """Rectangles on up to a third of the images, most of them cut off by the border."""
    count = len(draws)
    extent = rng.uniform(0.15, 0.6, (count, 2))
    start = rng.uniform(-0.3, 1.0, (count, 2))
    low = np.rint(np.clip(start, 0.0, 1.0) * size).astype(int)
    high = np.rint(np.clip(start + extent, 0.0, 1.0) * size).astype(int)
    # None covers the centre, whose depth would then give a window of another size.
    middle = ((low < size // 2 + 3) & (high > size // 2 - 3)).all(axis=1)
    shown = (rng.random(count) < 1 / 3) & ~middle
    draws["top"], draws["left"] = low.T
    draws["bottom"], draws["right"] = np.where(shown[:, None], high, low).T


def _draw_borders(rng: np.random.Generator, draws: np.ndarray, size: int) -> None:
    """The image ends within a tenth of the windows, on one side or on two, never at the centre."""
    shape = len(draws), 2  # up or down, left or right
    beyond = np.where(rng.random(shape) < _CUT_OFF, rng.uniform(0.0, 0.5, shape), 0.0)
    beyond = np.rint(beyond * size).astype(int)
    before = rng.random(shape) < 0.5
    draws["image"][:, ::2] = np.where(before, beyond, 0)
    draws["image"][:, 1::2] = size - np.where(before, 0, beyond)


def _draw_colors(rng: np.random.Generator, draws: np.ndarray) -> None:
    """White balance, exposure and saturation of the object; the camera's effects."""
    count = len(draws)
    gain = np.exp(rng.normal(0.0, 0.2, (count, 3)) + rng.uniform(-0.7, 0.35, (count, 1)))
    saturation = np.maximum(rng.normal(1.0, 0.3, (count, 1, 1)), 0.0)
    grey = np.array([0.299, 0.587, 0.114])
    # grey + (colour − grey)·saturation, times gain, as one matrix.
    draws["color_mix"] = gain[:, :, None] * (saturation * np.eye(3) + (1.0 - saturation) * grey)
    draws["exposure"] = np.exp(rng.uniform(-0.7, 0.2, count))
    draws["gamma"] = np.exp(rng.normal(0.0, 0.2, count))
    draws["contrast"] = np.maximum(rng.normal(1.0, 0.2, count), 0.3)
    draws["blurs"] = rng.choice([0, 1, 2], count, p=[0.5, 0.25, 0.25])
    draws["color_noise"] = rng.uniform(0.0, 0.04, count)


def _draw_depths(rng: np.random.Generator, draws: np.ndarray) -> None:
    """Planes of backgrounds and occluders, the sensor's noise and holes."""
    count = len(draws)
    offsets = {"background_plane": (-0.2, 1.2), "occluder_plane": (-0.8, -0.1)}
    for name, (low, high) in offsets.items():
        slopes = rng.normal(0.0, 0.5, (count, 2))
        draws[name] = np.column_stack([rng.uniform(low, high, count), slopes])
    height = rng.uniform(0.0, 0.4, (count, 1, 1))
    draws["background_heights"] = rng.standard_normal((count, 4, 4)) * height
    draws["background_offset"] = rng.uniform(0.0, 0.6, count)
    draws["depth_shift"] = rng.normal(0.0, 0.02, count)
    draws["depth_noise"] = rng.uniform(0.0, 0.03, count)
    draws["holes"] = rng.standard_normal((count, 16, 16))
    draws["hole_level"] = rng.uniform(1.2, 4.0, count)
