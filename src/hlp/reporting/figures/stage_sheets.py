"""What the stages work with: sheets of views, training windows and patches."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Bool, Float, Int

from hlp.arrays import Rgb
from hlp.records import MILLIMETRES_PER_METRE, LocalPatches, Views
from hlp.reporting.figures import size_of, titled, with_legend, write_words

NOTHING = 128
"""Grey level where a tile shows nothing: that of patches beyond the range of depth."""
_DEPTHS = cv2.COLORMAP_VIRIDIS  # without any grey, which means that there is no depth
_GAP, _DARK, _WORDS = 4, 24, 16
_SMALL = 0.38  # of words
_VIEWS, _VIEW_SIZE, _BACK = 12, 84, 200  # of an object; px; grey level outside the object
_PATCH_SIZE = 64  # px
_WINDOWS = 8  # of a class
_MISSING = 0.999  # of a window's depth channel: missing depth is 1


def draw_view_sheet(views: Mapping[str, Views]) -> Rgb:
    """Views of each object, by its name, spread evenly over all of them."""
    rows = []
    for name, rendered in views.items():
        tiles = []
        for view in _spread(np.arange(len(rendered)), _VIEWS):
            seen = np.asarray(rendered.depth[view]) > 0
            tile = np.where(seen[..., None], rendered.rgb[view], _BACK).astype(np.uint8)
            tiles.append(resized(tile, _VIEW_SIZE))
        rows.append((name, tiles))
    counts = sorted({len(rendered) for rendered in views.values()})
    number = f"{counts[0]}" if len(counts) == 1 else f"{counts[0]} to {counts[-1]}"
    title = f"Rendered views, each under another light: some of the {number} of each object"
    return titled(sheet(rows), title)


def draw_training_samples(
    images: Float[np.ndarray, "n c p p"], labels: Int[np.ndarray, "n"], names: Sequence[str]
) -> Rgb:
    """Some windows of each class: colour and, with four channels, depth beside it.

    Images are in [-1, 1], as the network takes them; `names` are those of the classes.
    """
    rows = []
    for label, name in enumerate(names):
        tiles = []
        for i in _spread(np.flatnonzero(labels == label), _WINDOWS):
            shown = [_color(images[i, :3].transpose(1, 2, 0))]
            if images.shape[1] == 4:
                shown.append(depth_tile(images[i, 3], images[i, 3] < _MISSING))
            tiles.append(np.hstack(shown))
        rows.append((name, tiles))
    picture = titled(sheet(rows), "What the classifier is trained on: some windows of each class")
    words = "background: also windows that show an object badly centred or at a wrong size"
    picture = with_legend(picture, [(words, (_DARK,) * 3)])
    return with_depths(picture) if images.shape[1] == 4 else picture


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


def draw_nearest_entries(found: Sequence[PatchEntries]) -> Rgb:
    """A row for each patch: itself, then its nearest entries; colour and depth of each."""
    rows = []
    for near in found:
        entries = zip(near.distances, MILLIMETRES_PER_METRE * near.apart, strict=True)
        words = [f"{distance:.2f}, {apart:.0f} mm off" for distance, apart in entries]
        tiles = [
            below(_patch_tile(color, depth_tile(depth, valid)), word)
            for color, depth, valid, word in zip(
                near.patches.color,
                near.patches.depth,
                near.patches.valid,
                ["patch in the image", *words],
                strict=True,
            )
        ]
        rows.append((near.name, tiles))
    title = "Local patches of images, and the codebook entries with the most similar features"
    words_below = "below an entry: distance of features, and how far it is from the true place"
    return with_depths(titled(sheet(rows), title), words_below)


def _patch_tile(color: Rgb, depth: Rgb) -> Rgb:
    """Colour and depth of a local patch beside each other."""
    return np.asarray(np.hstack([resized(color, _PATCH_SIZE), resized(depth, _PATCH_SIZE)]))


def _spread(items: Int[np.ndarray, "n"], most: int) -> Int[np.ndarray, "m"]:
    count = min(most, len(items))
    return items[[i * len(items) // count for i in range(count)]]


def _color(channels: Float[np.ndarray, "p p 3"]) -> Rgb:
    """From [-1, 1], as networks take colours."""
    return np.asarray(np.rint(127.5 * (np.clip(channels, -1.0, 1.0) + 1.0)), dtype=np.uint8)


def depth_tile(depth: Float[np.ndarray, "p p"], valid: Bool[np.ndarray, "p p"]) -> Rgb:
    """Relative depth from -1 (near, yellow) to 1 (far, violet); grey where it is not valid."""
    return np.where(valid[..., None], _colors(depth), NOTHING).astype(np.uint8)


def with_depths(picture: Rgb, words: str = "") -> Rgb:
    """The picture above a legend of the colours of depth, and further words (ASCII)."""
    near, middle, far = _colors(np.array([[-1.0, 0.0, 1.0]]))[0].tolist()
    entries = [
        ("depth: near", tuple(near)),
        ("as the middle", tuple(middle)),
        ("far", tuple(far)),
        ("none, or outside", (NOTHING,) * 3),
    ]
    shown = with_legend(picture, entries)
    return with_legend(shown, [(words, (_DARK,) * 3)]) if words else shown


def resized(tile: Rgb, size: int) -> Rgb:
    """A square tile with sides of `size` px; pixels stay square where it grows."""
    way = cv2.INTER_AREA if size < len(tile) else cv2.INTER_NEAREST
    return np.asarray(cv2.resize(tile, (size, size), interpolation=way), dtype=np.uint8)


def below(tile: Rgb, words: str) -> Rgb:
    """The tile with words (ASCII) below it."""
    bar = np.full((_WORDS, tile.shape[1], 3), _DARK, dtype=np.uint8)
    write_words(bar, words, (2, _WORDS - 5), _SMALL)
    return np.vstack([tile, bar])


def sheet(rows: Sequence[tuple[str, Sequence[Rgb]]]) -> Rgb:
    """Rows of tiles of one size, each behind its name (ASCII). Shorter rows are filled up.

    Raises ValueError without any tile.
    """
    longest = max((len(tiles) for _, tiles in rows), default=0)
    if longest == 0:
        raise ValueError("a sheet needs at least one tile")
    height, width, _ = next(tiles[0].shape for _, tiles in rows if tiles)
    left = max(size_of(name, _SMALL)[0] for name, _ in rows) + 2 * _GAP
    shape = (len(rows) * (height + _GAP), left + longest * (width + _GAP), 3)
    whole = np.full(shape, _DARK, dtype=np.uint8)
    for row, (name, tiles) in enumerate(rows):
        top = row * (height + _GAP)
        line = whole[top : top + height]
        write_words(line, name, (_GAP, height // 2 + 4), _SMALL)
        for column, tile in enumerate(tiles):
            at = left + column * (width + _GAP)
            line[:, at : at + width] = tile
    return whole


def _colors(depth: Float[np.ndarray, "h w"]) -> Rgb:
    levels = np.rint(127.5 * (1.0 - np.clip(depth, -1.0, 1.0))).astype(np.uint8)
    colors = cv2.cvtColor(cv2.applyColorMap(levels, _DEPTHS), cv2.COLOR_BGR2RGB)
    return np.asarray(colors, dtype=np.uint8)
