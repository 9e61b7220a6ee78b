"""Sheets of small images: rows with a name, tiles beside each other, words below them."""

from collections.abc import Sequence

import cv2
import numpy as np
from jaxtyping import Bool, Float, UInt8

from hlp.records import LocalPatches
from hlp.reporting.figures.captions import with_legend

Image = UInt8[np.ndarray, "h w 3"]

NOTHING = 128
"""Grey level where a tile shows nothing: that of patches beyond the range of depth."""
_DEPTHS = cv2.COLORMAP_VIRIDIS  # without any grey, which means that there is no depth
_GAP, _DARK, _WORDS = 4, 24, 16
_FONT, _SMALL, _LIGHT = cv2.FONT_HERSHEY_SIMPLEX, 0.38, (235, 235, 235)


def depth_tile(depth: Float[np.ndarray, "p p"], valid: Bool[np.ndarray, "p p"]) -> Image:
    """Relative depth from -1 (near, yellow) to 1 (far, violet); grey where it is not valid."""
    return np.where(valid[..., None], _colors(depth), NOTHING).astype(np.uint8)


def patch_tile(patches: LocalPatches, row: int, size: int) -> Image:
    """Colour and depth of a local patch beside each other, each with sides of `size` px."""
    depth = depth_tile(patches.depth[row], patches.valid[row])
    return beside([resized(patches.color[row], size), resized(depth, size)])


def with_depths(picture: Image, words: str = "", *, missing: bool = True) -> Image:
    """The picture above a legend of the colours of depth, and further words (ASCII).

    Without `missing`, the legend does not name the grey of missing depth.
    """
    near, middle, far = _colors(np.array([[-1.0, 0.0, 1.0]]))[0].tolist()
    entries = [
        ("depth: near", tuple(near)),
        ("as the middle", tuple(middle)),
        ("far", tuple(far)),
    ]
    if missing:
        entries.append(("none, or outside", (NOTHING,) * 3))
    shown = with_legend(picture, entries)
    return with_legend(shown, [(words, (_DARK,) * 3)]) if words else shown


def resized(tile: Image, size: int) -> Image:
    """A square tile with sides of `size` px; pixels stay square where it grows."""
    way = cv2.INTER_AREA if size < len(tile) else cv2.INTER_NEAREST
    return np.asarray(cv2.resize(tile, (size, size), interpolation=way), dtype=np.uint8)


def beside(tiles: Sequence[Image]) -> Image:
    """Tiles of one height in a row, without gaps."""
    return np.hstack(list(tiles))


def below(tile: Image, words: str) -> Image:
    """The tile with words (ASCII) below it."""
    bar = np.full((_WORDS, tile.shape[1], 3), _DARK, dtype=np.uint8)
    cv2.putText(bar, words, (2, _WORDS - 5), _FONT, _SMALL, _LIGHT, 1, cv2.LINE_AA)
    return np.vstack([tile, bar])


def sheet(rows: Sequence[tuple[str, Sequence[Image]]]) -> UInt8[np.ndarray, "_ _ 3"]:
    """Rows of tiles of one size, each behind its name (ASCII). Shorter rows are filled up.

    Raises ValueError without any tile.
    """
    longest = max((len(tiles) for _, tiles in rows), default=0)
    if longest == 0:
        raise ValueError("a sheet needs at least one tile")
    shape = next(tiles[0].shape for _, tiles in rows if tiles)
    empty = np.full(shape, _DARK, dtype=np.uint8)
    lengths = [cv2.getTextSize(name, _FONT, _SMALL, 1)[0][0] for name, _ in rows]
    left = max(lengths) + 2 * _GAP
    lines = []
    for name, tiles in rows:
        label = np.full((shape[0], left, 3), _DARK, dtype=np.uint8)
        place = (_GAP, shape[0] // 2 + 4)
        cv2.putText(label, name, place, _FONT, _SMALL, _LIGHT, 1, cv2.LINE_AA)
        filled = [*tiles, *[empty] * (longest - len(tiles))]
        lines.append(_framed(np.hstack([label, *(_framed(tile, 1) for tile in filled)]), 0))
    return np.vstack(lines)


def _colors(depth: Float[np.ndarray, "h w"]) -> Image:
    levels = np.rint(127.5 * (1.0 - np.clip(depth, -1.0, 1.0))).astype(np.uint8)
    colors = cv2.cvtColor(cv2.applyColorMap(levels, _DEPTHS), cv2.COLOR_BGR2RGB)
    return np.asarray(colors, dtype=np.uint8)


def _framed(tile: Image, axis: int) -> Image:
    """A gap behind (axis 1) or below (axis 0) a tile."""
    height, width = tile.shape[:2]
    shape = (height, _GAP, 3) if axis else (_GAP, width, 3)
    return np.concatenate([tile, np.full(shape, _DARK, dtype=np.uint8)], axis=axis)
