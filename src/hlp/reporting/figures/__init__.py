"""Figures of results, and pictures of what the stages see; here how they are saved and titled."""

import base64
import io
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import cv2
import numpy as np

from hlp.arrays import Rgb

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def new_figure(width: float, height: float) -> "Figure":
    """An empty figure of that size (inches), whose parts make room for each other."""
    from matplotlib.figure import Figure  # takes long to import

    return Figure(figsize=(width, height), layout="constrained")


def save_jpeg(figure: "Figure", path: Path) -> None:
    """Write a figure as a JPEG. Raises OSError for a path that cannot be written."""
    figure.savefig(path, dpi=110, pil_kwargs={"quality": 88, "optimize": True})


def save_figure(figure: "Figure", path: Path) -> list[Path]:
    """Write `path`.png and `path`.svg; those files. Equal figures give equal files."""
    files = [path.with_name(f"{path.name}.{ending}") for ending in ("png", "svg")]
    figure.savefig(files[0], dpi=150)
    files[1].write_bytes(as_svg(figure))
    return files


def in_base64(content: bytes) -> str:
    """A picture or numbers as they stand in a page."""
    return base64.b64encode(content).decode("ascii")


def as_svg(figure: "Figure") -> bytes:
    """A figure as SVG."""
    import matplotlib

    stream = io.BytesIO()
    with matplotlib.rc_context({"svg.hashsalt": "hlp"}):
        figure.savefig(stream, format="svg", metadata={"Date": None})
    return stream.getvalue()


Color = tuple[int, int, int]

TITLE_HEIGHT, LEGEND_HEIGHT = 26, 20
_DARK, _LIGHT = 24, (235, 235, 235)
_FONT = cv2.FONT_HERSHEY_SIMPLEX
_PAD, _SMALL = 8, 0.42


def titled(picture: Rgb, title: str, scale: float = 0.5) -> Rgb:
    """The picture below a bar with its title (ASCII), which is made narrower if it is too long."""
    width = picture.shape[1]
    bar = np.full((round(TITLE_HEIGHT / 0.5 * scale), width, 3), _DARK, dtype=np.uint8)
    scale *= min(1.0, (width - 2 * _PAD) / max(width_of(title, scale), 1))
    write_words(bar, title, (_PAD, len(bar) - _PAD), scale)
    return np.vstack([bar, picture])


def with_legend(picture: Rgb, entries: Sequence[tuple[str, Color]]) -> Rgb:
    """The picture above a bar with coloured squares and their meanings."""
    bar = np.full((LEGEND_HEIGHT, picture.shape[1], 3), _DARK, dtype=np.uint8)
    x = _PAD
    for words, color in entries:
        cv2.rectangle(bar, (x, 5), (x + 10, 15), color, -1)
        x = write_words(bar, words, (x + 15, 14)) + 14
    return np.vstack([picture, bar])


def width_of(words: str, scale: float = _SMALL) -> int:
    """Width of written words (px)."""
    return int(cv2.getTextSize(words, _FONT, scale, 1)[0][0])


def write_words(
    picture: Rgb,
    words: str,
    place: tuple[int, int],
    scale: float = _SMALL,
    color: Color = _LIGHT,
    thickness: int = 1,
) -> int:
    """Write words (ASCII) into the picture itself, from a place on; x of their end."""
    cv2.putText(picture, words, place, _FONT, scale, color, thickness, cv2.LINE_AA)
    return place[0] + width_of(words, scale)
