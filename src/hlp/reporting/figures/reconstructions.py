"""Local patches beside what the autoencoder rebuilds from their features."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, UInt8

from hlp.reporting.figures.captions import titled
from hlp.reporting.figures.tiles import below, beside, depth_tile, resized, sheet, with_depths

_SIZE = 64


@dataclass(frozen=True)
class ReconstructedPatches:
    """Patches of one target, and what was rebuilt of them: the encoder's channels in [-1, 1].

    The first three channels are colour or normals, the last one is relative depth.
    """

    name: str
    patches: Float[np.ndarray, "n p p 4"]
    rebuilt: Float[np.ndarray, "n p p 4"]


def draw_reconstructions(found: Sequence[ReconstructedPatches]) -> UInt8[np.ndarray, "_ _ 3"]:
    """Two rows for each target: its patches, and below them what was rebuilt, with its error."""
    rows = []
    for each in found:
        errors = np.sqrt(((each.patches - each.rebuilt) ** 2).mean(axis=(1, 2, 3)))
        rows.append((each.name, [below(_tile(one), "patch") for one in each.patches]))
        words = [f"rebuilt, error {error:.2f}" for error in errors]
        tiles = [below(_tile(one), word) for one, word in zip(each.rebuilt, words, strict=True)]
        rows.append(("", tiles))
    title = "Local patches and what the autoencoder rebuilds from their features"
    legend = "out of range: grey and far; error: root mean square over all channels, from -1 to 1"
    return with_depths(titled(sheet(rows), title), legend, missing=False)


def _tile(channels: Float[np.ndarray, "p p 4"]) -> UInt8[np.ndarray, "_ _ 3"]:
    color = np.rint(127.5 * (np.clip(channels[..., :3], -1.0, 1.0) + 1.0)).astype(np.uint8)
    depth = channels[..., 3]
    shown = depth_tile(depth, np.ones(depth.shape, dtype=bool))
    return beside([resized(color, _SIZE), resized(shown, _SIZE)])
