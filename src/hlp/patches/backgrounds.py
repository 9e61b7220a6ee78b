"""Images without any target object, which training needs in addition to the CAD models."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import cv2
import numpy as np
from jaxtyping import Float, UInt8

from hlp.arrays import ColorPatches
from hlp.errors import ConfigError
from hlp.records import Frame


class Backgrounds(Protocol):
    """Source of backgrounds for training."""

    def photograph_crops(self, count: int, size: int, rng: np.random.Generator) -> ColorPatches:
        """Random square crops (RGB) of photographs, or procedural ones."""

    def load_background_frames(self) -> Sequence[Frame]:
        """RGB-D frames used as backgrounds of rendered objects; may be empty."""

    def load_encoder_frames(self) -> Sequence[Frame]:
        """RGB-D frames that train the autoencoder (only encoder=cae).

        Raises ValueError if there are none.
        """


@dataclass(frozen=True)
class GivenBackgrounds:
    """Procedural crops, and RGB-D frames given by the caller, of places without the objects."""

    frames: tuple[Frame, ...] = ()

    def photograph_crops(self, count: int, size: int, rng: np.random.Generator) -> ColorPatches:
        """See `Backgrounds`: procedural ones."""
        return procedural_backgrounds(count, size, rng)

    def load_background_frames(self) -> Sequence[Frame]:
        """See `Backgrounds`."""
        return self.frames

    def load_encoder_frames(self) -> Sequence[Frame]:
        """See `Backgrounds`."""
        if not self.frames:
            raise ConfigError("encoder=cae trains on RGB-D frames without the objects: give some")
        return self.frames


_OCTAVES = (2, 4, 8, 16, 32)
_LARGEST_BATCH = 512


def procedural_backgrounds(count: int, size: int, rng: np.random.Generator) -> ColorPatches:
    """Random textured pictures, used when no photographs are given.

    Each has smooth coloured noise and a gradient, most have clutter (filled polygons, ellipses,
    lines), a third have stripes or checks; grain and exposure differ from one to the next.
    Deterministic in `rng`.
    """
    pictures = np.empty((count, size, size, 3), np.uint8)
    for start in range(0, count, _LARGEST_BATCH):
        stop = min(start + _LARGEST_BATCH, count)
        pictures[start:stop] = _batch(stop - start, size, rng)
    return pictures


def _batch(count: int, size: int, rng: np.random.Generator) -> ColorPatches:
    base = _noise(count, size, rng) + _gradients(count, size, rng)
    pictures = np.ascontiguousarray(np.clip(base * 255.0, 0, 255), dtype=np.uint8)
    for picture in pictures:
        if rng.random() < 1 / 3:
            _stripes(picture, rng)
        if rng.random() < 0.8:
            _clutter(picture, rng)
    light = rng.uniform(0.4, 1.2, (count, 1, 1, 1)).astype(np.float32)
    strength = rng.uniform(0.0, 12.0, (count, 1, 1, 1)).astype(np.float32)
    grain = rng.standard_normal(pictures.shape, dtype=np.float32) * strength
    return np.asarray(np.clip(pictures * light + grain, 0, 255), dtype=np.uint8)


def _noise(count: int, size: int, rng: np.random.Generator) -> Float[np.ndarray, "n s s 3"]:
    """Octaves of interpolated noise around a base colour; coarse octaves are stronger."""
    # Saturated colours are rare indoors: mix each base colour with its grey.
    color = rng.uniform(0.05, 0.95, (count, 1, 1, 3))
    grey = color.mean(axis=-1, keepdims=True)
    total = grey + (color - grey) * rng.beta(1.5, 2.5, (count, 1, 1, 1))
    total = np.broadcast_to(total, (count, size, size, 3)).astype(np.float32, order="C")
    decay = rng.uniform(0.35, 0.8, count)
    contrast = rng.uniform(0.02, 0.25, count)
    for level, cells in enumerate(o for o in _OCTAVES if o <= max(size, _OCTAVES[0])):
        grids = rng.standard_normal((count, cells, cells, 3), dtype=np.float32)
        colorful = rng.random((count, 1, 1, 1)) < 0.5
        grids = np.where(colorful, grids, grids[..., :1])
        for picture, grid, weight in zip(total, grids, contrast * decay**level, strict=True):
            picture += weight * cv2.resize(grid, (size, size), interpolation=cv2.INTER_CUBIC)
    return total


def _gradients(count: int, size: int, rng: np.random.Generator) -> Float[np.ndarray, "n s s 1"]:
    """A linear change of brightness across each picture."""
    angle = rng.uniform(0, 2 * np.pi, (count, 1, 1))
    slope = rng.uniform(0.0, 0.5, (count, 1, 1))
    y, x = np.mgrid[0:size, 0:size] / size - 0.5
    change = slope * (np.cos(angle) * x + np.sin(angle) * y)
    return np.asarray(change[..., None], dtype=np.float32)


def _stripes(picture: UInt8[np.ndarray, "s s 3"], rng: np.random.Generator) -> None:
    """Lay stripes, or a chess-board of two directions, over a picture in place."""
    size = len(picture)
    y, x = np.mgrid[0:size, 0:size]
    angle, period = rng.uniform(0, np.pi), rng.uniform(3.0, max(size / 2, 4.0))
    wave = np.sin((np.cos(angle) * x + np.sin(angle) * y) * 2 * np.pi / period)
    if rng.random() < 0.5:
        wave = wave * np.sin((np.cos(angle) * y - np.sin(angle) * x) * 2 * np.pi / period)
    marked = wave > rng.uniform(-0.5, 0.5)
    picture[marked] = 0.5 * picture[marked] + 0.5 * rng.integers(0, 256, 3)


def _clutter(picture: UInt8[np.ndarray, "s s 3"], rng: np.random.Generator) -> None:
    """Draw one to six shapes of one colour each over a picture in place."""
    size = len(picture)
    for _ in range(int(rng.integers(1, 7))):
        color = tuple(int(value) for value in rng.integers(0, 256, 3))
        center = rng.integers(0, size, 2)
        kind = rng.integers(3)
        if kind == 0:
            corners = center + rng.normal(0, size / 4, (int(rng.integers(3, 7)), 2))
            hull = cv2.convexHull(corners.astype(np.int32)).reshape(-1, 2)
            cv2.fillConvexPoly(picture, hull, color, cv2.LINE_AA)
        elif kind == 1:
            axes = tuple(int(v) for v in rng.integers(1, max(size // 3, 2), 2))
            place = (int(center[0]), int(center[1]))
            cv2.ellipse(picture, place, axes, rng.uniform(0, 180), 0, 360, color, -1, cv2.LINE_AA)
        else:
            ends = center + rng.normal(0, size / 2, (2, 2))
            first, last = (tuple(int(v) for v in end) for end in ends)
            width = int(rng.integers(1, max(size // 12, 2)))
            cv2.line(picture, first, last, color, width, cv2.LINE_AA)
