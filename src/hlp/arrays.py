"""Names for the arrays that most functions of the method take or return, with their shapes; seeds.

Lengths are in metres, pixels are counted (x, y) from the centre of the first one.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np
from jaxtyping import Bool, Float, Int, UInt8, UInt16

_Item = TypeVar("_Item")
_Key = TypeVar("_Key")

Pose = Float[np.ndarray, "4 4"]
"""A rigid motion, nearly always from object to camera coordinates."""
Poses = Float[np.ndarray, "n 4 4"]
CameraMatrix = Float[np.ndarray, "3 3"]
Rotation = Float[np.ndarray, "3 3"]
Point = Float[np.ndarray, "3"]
Vector = Float[np.ndarray, "3"]
"""A direction, a normal or an offset."""
Points = Float[np.ndarray, "n 3"]
Pixels = Int[np.ndarray, "n 2"]
Positions = Float[np.ndarray, "n 2"]
"""Places in an image, also between pixels."""
Image = Float[np.ndarray, "h w"]
"""An image of one channel: depth, 0 where it is missing, or what is computed from it."""
Rgb = UInt8[np.ndarray, "h w 3"]
Mask = Bool[np.ndarray, "h w"]
Values = Float[np.ndarray, "n"]
Flags = Bool[np.ndarray, "n"]
Rows = Int[np.ndarray, "n"]
Features = Float[np.ndarray, "n d"]
DepthPatches = Float[np.ndarray, "n p p"]
DepthCodes = UInt8[np.ndarray, "n p p"]
"""Depth in 8 bits: see `patches.holistic.depth_code`."""
MaskPatches = Bool[np.ndarray, "n p p"]
ColorPatches = UInt8[np.ndarray, "n p p 3"]


@dataclass(frozen=True)
class StoredDepth:
    """Depth images in whole steps of `unit` (m), as on disk; an index gives metres (float32)."""

    steps: UInt16[np.ndarray, "n s s"]
    unit: float

    def __getitem__(self, index: Any) -> Float[np.ndarray, "..."]:
        return np.asarray(self.steps[index] * np.float32(self.unit), dtype=np.float32)

    @property
    def shape(self) -> tuple[int, ...]:
        """Of all images."""
        return self.steps.shape


def spread(items: Sequence[_Item], most: int | None) -> tuple[_Item, ...]:
    """`most` of the items, or all, spread evenly; None: all."""
    count = len(items) if most is None else min(most, len(items))
    return tuple(items[i * len(items) // count] for i in range(count))


def grouped(items: Iterable[_Item], key: Callable[[_Item], _Key]) -> dict[_Key, list[_Item]]:
    """The items by what `key` says of each; groups and items in the order in which they come."""
    groups: dict[_Key, list[_Item]] = {}
    for item in items:
        groups.setdefault(key(item), []).append(item)
    return groups


def derive_seed(*parts: int) -> int:
    """One seed from several numbers: frames and objects have independent random numbers."""
    return int(np.random.SeedSequence(parts).generate_state(1)[0])
