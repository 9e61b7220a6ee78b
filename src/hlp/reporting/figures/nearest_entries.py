"""Local patches of real images beside the codebook entries that are nearest to them."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, UInt8

from hlp.records import MILLIMETRES_PER_METRE, LocalPatches
from hlp.reporting.figures.captions import titled
from hlp.reporting.figures.tiles import below, patch_tile, sheet, with_depths

_SIZE = 64


@dataclass(frozen=True)
class PatchEntries:
    """A patch (row 0) and its nearest entries (rows 1 …), nearest first, all with colour.

    `distances` are those of the features, `apart` (m) how far each entry's place on the object is
    from the true place of the patch.
    """

    name: str
    patches: LocalPatches
    distances: Float[np.ndarray, "k"]
    apart: Float[np.ndarray, "k"]


def draw_nearest_entries(found: Sequence[PatchEntries]) -> UInt8[np.ndarray, "_ _ 3"]:
    """A row for each patch: itself, then its nearest entries; colour and depth of each."""
    rows = []
    for each in found:
        tiles = [below(patch_tile(each.patches, 0, _SIZE), "patch in the image")]
        for rank, distance in enumerate(each.distances):
            words = f"{distance:.2f}, {MILLIMETRES_PER_METRE * each.apart[rank]:.0f} mm off"
            tiles.append(below(patch_tile(each.patches, rank + 1, _SIZE), words))
        rows.append((each.name, tiles))
    title = "Local patches of images, and the codebook entries with the most similar features"
    words = "below an entry: distance of features, and how far it is from the true place"
    return with_depths(titled(sheet(rows), title), words)
