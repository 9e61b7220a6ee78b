"""Recall of the arms of a ladder, and what each gains against the arm that it starts from."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Measured = tuple[float, tuple[float, float]]
"""A value and its 95 % interval."""


@dataclass(frozen=True)
class Step:
    """One arm: its recall, and what it gains (None: it starts from no other arm)."""

    name: str
    recall: Measured
    gain: Measured | None


def draw_steps(steps: Sequence[Step], title: str) -> "Figure":
    """A row an arm, the first at the top: recall on the left, the gain on the right.

    The axis of recall begins where the intervals do, which it says.
    """
    from matplotlib.figure import Figure

    figure = Figure(figsize=(8.0, 0.26 * len(steps) + 1.4), layout="constrained")
    left, right = figure.subplots(1, 2, sharey=True)
    rows = range(len(steps))
    _draw(left, rows, [step.recall for step in steps])
    left.set_yticks(rows, [f"{step.name}  {step.recall[0]:.3f}" for step in steps], fontsize=8)
    begin = _begin_of_axis([step.recall for step in steps])
    left.set_xlim(begin - 0.02 * (1.0 - begin), 1.0 + 0.02 * (1.0 - begin))
    left.invert_yaxis()
    left.set_xlabel("ADD(-S) recall" + (f" (axis cut: begins at {begin:g})" if begin else ""))
    with_gain = [(row, step.gain) for row, step in zip(rows, steps, strict=True) if step.gain]
    _draw(right, [row for row, _ in with_gain], [gain for _, gain in with_gain])
    right.axvline(0.0, color="0.4", linewidth=0.8)
    right.set_xlabel("gained against the arm that it starts from")
    for ax in (left, right):
        ax.grid(axis="x", alpha=0.3)
        ax.spines[["top", "right"]].set_visible(False)
    figure.suptitle(f"{title}; 95 % intervals", fontsize=10)
    return figure


def _begin_of_axis(recalls: Sequence[Measured]) -> float:
    """The largest tenth below all intervals."""
    lowest = min((low for _, (low, _) in recalls), default=0.0)
    return max(math.floor(10.0 * lowest - 1e-9), 0) / 10.0


def _draw(ax: "Axes", rows: Sequence[int], values: Sequence[Measured]) -> None:
    middle = [value for value, _ in values]
    below = [max(value - low, 0.0) for value, (low, _) in values]
    above = [max(high - value, 0.0) for value, (_, high) in values]
    ax.errorbar(middle, rows, xerr=(below, above), fmt="o", markersize=4, capsize=2)
