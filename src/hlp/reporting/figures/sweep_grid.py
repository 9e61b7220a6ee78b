"""A sweep of two settings as heat maps: ADD(-S) recall and time."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.image import AxesImage

Cell = tuple[float, float]
"""ADD(-S) recall, and the median time of an object in a frame (ms)."""


def draw_grid(
    cells: Mapping[tuple[str, str], Cell],
    axes: tuple[str, str],
    marked: tuple[str, str] | None,
    title: str,
) -> "Figure":
    """Recall left and time right, a cell for each pair of values; empty where no run finished.

    `axes` name the settings across and down; the `marked` cell, the default, has a frame.
    """
    from matplotlib.figure import Figure

    across = list(dict.fromkeys(pair[0] for pair in cells))
    down = list(dict.fromkeys(pair[1] for pair in cells))
    height = 1.6 + 0.45 * len(down)
    figure = Figure(figsize=(9.2, max(height, 2.8)), layout="constrained")
    left, right = figure.subplots(1, 2, sharey=True)
    for number, (ax, name) in enumerate(((left, "ADD(-S) recall"), (right, "ms, median"))):
        values = np.full((len(down), len(across)), np.nan)
        for (x, y), cell in cells.items():
            values[down.index(y), across.index(x)] = cell[number]
        draw_cells(
            ax,
            values,
            "viridis" if number == 0 else "viridis_r",
            "{:.3f}" if number == 0 else "{:.0f}",
        )
        ax.set_xticks(range(len(across)), across, fontsize=8)
        ax.set_yticks(range(len(down)), down, fontsize=8)
        ax.set_xlabel(axes[0])
        ax.set_title(name, fontsize=9)
        if marked in cells and marked is not None:
            _frame(ax, across.index(marked[0]), down.index(marked[1]))
    left.set_ylabel(axes[1])
    figure.suptitle(title, fontsize=10.5)
    return figure


def draw_cells(
    ax: "Axes",
    values: Float[np.ndarray, "rows columns"],
    colors: str,
    form: str,
    ends: tuple[float | None, float | None] = (None, None),
) -> "AxesImage":
    """A heat map with its numbers, written by `form`; NaN is said to be no result.

    `ends` are the values of the darkest and the brightest colour (None: those of the data).
    """
    image = ax.imshow(values, cmap=colors, aspect="auto", vmin=ends[0], vmax=ends[1])
    for (row, column), value in np.ndenumerate(values):
        if np.isnan(value):
            ax.text(column, row, "no result", ha="center", va="center", fontsize=8, color="0.5")
            continue
        red, green, blue, _ = image.cmap(image.norm(value))
        bright = 0.299 * red + 0.587 * green + 0.114 * blue > 0.55
        ax.text(column, row, form.format(value), ha="center", va="center", fontsize=9,
                color="black" if bright else "white")  # fmt: skip
    return image


def _frame(ax: "Axes", x: int, y: int) -> None:
    corners: Sequence[float] = (x - 0.47, x + 0.47, x + 0.47, x - 0.47, x - 0.47)
    heights: Sequence[float] = (y - 0.47, y - 0.47, y + 0.47, y + 0.47, y - 0.47)
    ax.plot(corners, heights, color="#d55e00", linewidth=2.5)
    ax.text(x, y + 0.36, "default", ha="center", va="center", fontsize=7, color="#d55e00",
            backgroundcolor="white")  # fmt: skip
