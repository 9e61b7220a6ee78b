"""What the classifier sees in training: windows after composition and degradation."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float, Int, UInt8

from hlp.reporting.figures.captions import titled, with_legend
from hlp.reporting.figures.tiles import beside, depth_tile, sheet, with_depths

_MOST, _DARK = 8, 24  # windows of a class
_MISSING = 0.999  # of the depth channel: missing depth is 1


def draw_training_samples(
    images: Float[np.ndarray, "n c p p"], labels: Int[np.ndarray, "n"], names: Sequence[str]
) -> UInt8[np.ndarray, "_ _ 3"]:
    """Some windows of each class: colour and, with four channels, depth beside it.

    Images are in [-1, 1], as the network takes them; `names` are those of the classes.
    """
    rows = []
    for label, name in enumerate(names):
        of_class = np.flatnonzero(labels == label)
        shown = min(_MOST, len(of_class))
        chosen = of_class[[i * len(of_class) // shown for i in range(shown)]]
        rows.append((name, [_tile(images[i]) for i in chosen]))
    picture = titled(sheet(rows), "What the classifier is trained on: some windows of each class")
    words = "background: also windows that show an object badly centred or at a wrong size"
    picture = with_legend(picture, [(words, (_DARK,) * 3)])
    return with_depths(picture) if images.shape[1] == 4 else picture


def _tile(image: Float[np.ndarray, "c p p"]) -> UInt8[np.ndarray, "p _ 3"]:
    color = np.rint(127.5 * (np.clip(image[:3], -1.0, 1.0) + 1.0)).astype(np.uint8)
    shown = [color.transpose(1, 2, 0)]
    if len(image) == 4:
        shown.append(depth_tile(image[3], image[3] < _MISSING))
    return beside(shown)
