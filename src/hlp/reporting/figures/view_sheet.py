"""Stage 0 as a contact sheet: some of the rendered views of each object."""

from collections.abc import Mapping

import numpy as np
from jaxtyping import UInt8

from hlp.records import Views
from hlp.reporting.figures.captions import titled
from hlp.reporting.figures.tiles import resized, sheet

_VIEWS, _SIZE = 12, 84
_BACK = 200  # grey level outside the object


def draw_view_sheet(views: Mapping[str, Views]) -> UInt8[np.ndarray, "_ _ 3"]:
    """Views of each object, by its name, spread evenly over all of them."""
    rows = []
    for name, each in views.items():
        shown = min(_VIEWS, len(each))
        chosen = [i * len(each) // shown for i in range(shown)]
        rows.append((name, [resized(_tile(each, view), _SIZE) for view in chosen]))
    counts = sorted({len(each) for each in views.values()})
    number = f"{counts[0]}" if len(counts) == 1 else f"{counts[0]} to {counts[-1]}"
    title = f"Rendered views, each under another light: some of the {number} of each object"
    return titled(sheet(rows), title)


def _tile(views: Views, view: int) -> UInt8[np.ndarray, "s s 3"]:
    seen = np.asarray(views.depth[view]) > 0
    return np.where(seen[..., None], views.rgb[view], _BACK).astype(np.uint8)
