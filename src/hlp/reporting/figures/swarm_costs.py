"""Stage 3: the cost of the swarm's particles by iteration."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_CHOSEN, _PARTICLES, _OTHER, _TRUE, _ANSWER = "#0072b2", "#56b4e9", "#8a8f98", "#d55e00", "black"
_COLUMNS = 3
_LABELS = _POINTS, _BEST, _REST, _TRUTH, _FOUND = (
    "each particle of the chosen swarm",
    "best of the chosen swarm",
    "best of another swarm",
    "true pose",
    "answer",
)


@dataclass(frozen=True)
class Swarm:
    """Costs of the particles in each round, the first one before any iteration.

    `chosen` says whether the answer was refined from this hypothesis.
    """

    costs: Float[np.ndarray, "rounds particles"]
    chosen: bool


@dataclass(frozen=True)
class SwarmsOfTarget:
    """The swarms of a target, one for each hypothesis, and the costs of its true pose and answer.

    Without an answer, `answer_cost` is None.
    """

    title: str
    swarms: Sequence[Swarm]
    true_cost: float
    answer_cost: float | None


def swarm_figure(targets: Sequence[SwarmsOfTarget]) -> "Figure":
    """A panel for each target: best cost of each swarm, and all particles of the chosen one."""
    from matplotlib.figure import Figure

    columns = min(_COLUMNS, len(targets))
    rows = -(-len(targets) // columns)
    figure = Figure(figsize=(max(3.9 * columns, 6.6), 2.9 * rows + 1.2), layout="constrained")
    grid = figure.subplots(rows, columns, squeeze=False)
    for ax in grid.flat[len(targets) :]:
        ax.set_axis_off()
    handles: dict[str, "Artist"] = {}
    for ax, target in zip(grid.flat, targets, strict=False):
        _draw(ax, target)
        drawn, names = ax.get_legend_handles_labels()
        handles |= dict(zip(names, drawn, strict=True))
    for ax in grid[:, 0]:
        ax.set_ylabel("cost (0: fits the depth image exactly)", fontsize=8)
    labels = [each for each in _LABELS if each in handles]
    figure.legend(
        [handles[each] for each in labels],
        labels,
        loc="outside lower center",
        ncols=min(5, columns + 2),
        frameon=False,
        fontsize=8,
    )
    title = "Particle swarm: costs of the poses that it tries, starting from coarse poses"
    if any(_lacks_chosen(target) for target in targets):
        title += "\nno chosen swarm: the answer's search cannot be repeated, as after a closer look"
    figure.suptitle(title, fontsize=11)
    return figure


def _lacks_chosen(target: SwarmsOfTarget) -> bool:
    return target.answer_cost is not None and not any(swarm.chosen for swarm in target.swarms)


def _draw(ax: "Axes", target: SwarmsOfTarget) -> None:
    for swarm in sorted(target.swarms, key=lambda each: each.chosen):
        rounds = np.arange(len(swarm.costs))
        best = np.minimum.accumulate(swarm.costs.min(axis=1))
        if swarm.chosen:
            x = np.repeat(rounds, swarm.costs.shape[1])
            ax.scatter(x, swarm.costs.ravel(), s=3, color=_PARTICLES, alpha=0.5, label=_POINTS)
            ax.plot(rounds, best, color=_CHOSEN, linewidth=2.2, label=_BEST)
        else:
            ax.plot(rounds, best, color=_OTHER, linewidth=1.1, label=_REST)
    ax.axhline(target.true_cost, color=_TRUE, linewidth=1.5, ls="--", label=_TRUTH)
    if target.answer_cost is not None:
        chosen = [swarm for swarm in target.swarms if swarm.chosen] or target.swarms
        last = max(len(swarm.costs) for swarm in chosen) - 1
        ax.plot(last, target.answer_cost, "*", color=_ANSWER, markersize=9, label=_FOUND)
    ax.set_title(target.title, fontsize=9)
    ax.set_xlabel("iteration")
    ax.margins(y=0.12)
    ax.set_ylim(bottom=0.0)
    ax.spines[["top", "right"]].set_visible(False)
    ax.grid(axis="y", alpha=0.3)


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
    _draw_steps(left, rows, [step.recall for step in steps])
    left.set_yticks(rows, [f"{step.name}  {step.recall[0]:.3f}" for step in steps], fontsize=8)
    begin = _begin_of_axis([step.recall for step in steps])
    left.set_xlim(begin - 0.02 * (1.0 - begin), 1.0 + 0.02 * (1.0 - begin))
    left.invert_yaxis()
    left.set_xlabel("ADD(-S) recall" + (f" (axis cut: begins at {begin:g})" if begin else ""))
    with_gain = [(row, step.gain) for row, step in zip(rows, steps, strict=True) if step.gain]
    _draw_steps(right, [row for row, _ in with_gain], [gain for _, gain in with_gain])
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


def _draw_steps(ax: "Axes", rows: Sequence[int], values: Sequence[Measured]) -> None:
    middle = [value for value, _ in values]
    below = [max(value - low, 0.0) for value, (low, _) in values]
    above = [max(high - value, 0.0) for value, (_, high) in values]
    ax.errorbar(middle, rows, xerr=(below, above), fmt="o", markersize=4, capsize=2)
