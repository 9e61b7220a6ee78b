"""Stage 3: the cost of the swarm's particles by iteration."""

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
    labels = [label for label in _LABELS if label in handles]
    figure.legend(
        [handles[label] for label in labels],
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
    for swarm in sorted(target.swarms, key=lambda swarm: swarm.chosen):
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
