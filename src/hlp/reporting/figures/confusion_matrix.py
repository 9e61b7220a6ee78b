"""Confusion matrix of the classifier at the true windows of a run's targets."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Int

from hlp.reporting.figures.saving import save_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure

NAME = "confusion"
_CELL = 0.42  # inches
_DARK = 0.55  # of a row, from which its words are white


@dataclass(frozen=True)
class Confusion:
    """Windows by true object (rows) and by the class that the classifier finds most likely."""

    objects: tuple[str, ...]
    classes: tuple[str, ...]
    counts: Int[np.ndarray, "o c"]

    @classmethod
    def of(cls, counts: Mapping[str, Mapping[str, int]]) -> "Confusion":
        """From `window_classes` of `summary.json`.

        Columns are the objects, then what else was said, background last.
        """
        objects = tuple(counts)
        others = dict.fromkeys(said for row in counts.values() for said in row)
        wrong = [said for said in others if said not in objects]
        classes = (*objects, *sorted(wrong, key=lambda said: said == "background"))
        table = [[counts[true].get(said, 0) for said in classes] for true in objects]
        return cls(objects, classes, np.array(table, dtype=np.int64).reshape(len(objects), -1))

    @property
    def right(self) -> int:
        """Windows whose most likely class is their object."""
        return int(np.trace(self.counts))

    @property
    def shares(self) -> np.ndarray:
        """The counts as shares of their rows."""
        return np.asarray(self.counts / np.maximum(self.counts.sum(axis=1, keepdims=True), 1))


def draw_confusion(folder: Path, counts: Mapping[str, Mapping[str, int]]) -> None:
    """Write confusion.png and confusion.svg; nothing without any window.

    `counts` are `window_classes` of `summary.json`.
    """
    if counts:
        save_figure(confusion_figure(Confusion.of(counts)), folder / NAME)


def confusion_figure(found: Confusion) -> "Figure":
    """Numbers of windows, shaded by their share of a row."""
    from matplotlib.figure import Figure

    rows, columns = found.counts.shape
    size = (max(_CELL * columns + 2.2, 5.4), max(_CELL * rows + 2.0, 3.2))
    figure = Figure(figsize=size, layout="constrained")
    axes = figure.subplots()
    axes.imshow(found.shares, cmap="Blues", vmin=0.0, vmax=1.0)
    for (row, column), count in np.ndenumerate(found.counts):
        if count:
            color = "white" if found.shares[row, column] > _DARK else "black"
            axes.text(column, row, str(count), ha="center", va="center", color=color, fontsize=8)
    axes.set_xticks(range(columns), found.classes, rotation=45, ha="right", fontsize=8)
    axes.set_yticks(range(rows), found.objects, fontsize=8)
    axes.set_xlabel("most likely class of the window")
    axes.set_ylabel("object that it shows")
    total = int(found.counts.sum())
    axes.set_title(f"{found.right} of {total} windows at targets are classified right", fontsize=10)
    return figure
