"""What the stages work with: viewpoints, and the costs of the swarm's particles by iteration."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float

from hlp.records import Views

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from mpl_toolkits.mplot3d.axes3d import Axes3D  # type: ignore[import-untyped]


_NEAR, _FAR = "#0072b2", "#b9d3e6"
_FROM = {"from the side": (12.0, -60.0), "from above": (90.0, -90.0)}
_DIGITS = 4  # to which directions are rounded, to find equal ones


def viewpoint_figure(views: Views, name: str) -> "Figure":
    """The sphere of viewpoints in object coordinates, from the side and from above (paper, 3.1)."""
    from matplotlib.figure import Figure

    points = directions(views)
    angles = nearest_angles_deg(points)
    figure = Figure(figsize=(8.4, 4.4), layout="constrained")
    for number, (title, (up, turn)) in enumerate(_FROM.items(), 1):
        axes = figure.add_subplot(1, 2, number, projection="3d", proj_type="ortho")
        _draw_sphere(axes, points, up, turn)
        if number == 1:
            axes.legend(
                loc="upper center", bbox_to_anchor=(0.5, 0.12), ncols=2, frameon=False, fontsize=8
            )
        axes.set_title(title, fontsize=10)
    figure.suptitle(
        f"Where the views of {name} are rendered from: {len(points)} viewpoints,"
        f" {len(views) / len(points):.3g} turns of the camera at each\n"
        f"nearest viewpoints are {np.median(angles):.1f}° apart"
        f" ({angles.min():.1f}° to {angles.max():.1f}°)",
        fontsize=11,
    )
    return figure


def directions(views: Views) -> Float[np.ndarray, "n 3"]:
    """Unit vectors from the object to the viewpoints, each once, in object coordinates."""
    poses = np.asarray(views.poses_cam_obj, dtype=np.float64)
    # The object's centroid lies on the optical axis, whatever its origin.
    back = -poses[:, 2, :3]
    unit = back / np.linalg.norm(back, axis=1, keepdims=True)
    _, first = np.unique(np.round(unit, _DIGITS), axis=0, return_index=True)
    return np.asarray(unit[np.sort(first)])


def nearest_angles_deg(points: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n"]:
    """Angle of each direction to the nearest other one; nan if there is but one."""
    if len(points) < 2:
        return np.full(len(points), np.nan)
    cosines = points @ points.T
    np.fill_diagonal(cosines, -1.0)
    return np.asarray(np.rad2deg(np.arccos(np.clip(cosines.max(axis=1), -1.0, 1.0))))


def _draw_sphere(axes: "Axes3D", points: Float[np.ndarray, "n 3"], up: float, turn: float) -> None:
    """Points of the half that faces the reader are dark; the object's axes are arrows."""
    axes.view_init(up, turn)
    a, b = np.deg2rad([up, turn])
    eye = np.array([np.cos(a) * np.cos(b), np.cos(a) * np.sin(b), np.sin(a)])
    halves = {"behind": (points @ eye < 0, _FAR), "in front": (points @ eye >= 0, _NEAR)}
    for word, (half, color) in halves.items():
        axes.scatter(*points[half].T, s=9, color=color, depthshade=False, label=word)
    turns = np.linspace(0, 2 * np.pi, 90)
    axes.plot(np.cos(turns), np.sin(turns), 0 * turns, color="#8a8f98", linewidth=0.8)
    for axis, word in zip(np.eye(3), "xyz", strict=True):
        if abs(axis @ eye) > 0.99:  # it points at the reader
            continue
        axes.quiver(0, 0, 0, *(0.45 * axis), color="black", linewidth=1.2)
        axes.text(*(0.55 * axis), word, fontsize=9)
    low = min(0.0, float(points[:, 2].min()))
    axes.set(xlim=(-1, 1), ylim=(-1, 1), zlim=(low, 1))
    axes.set_box_aspect((2.0, 2.0, 1.0 - low), zoom=1.2)
    axes.set_axis_off()


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
class SwarmsOfTarget:
    """The swarms of a target, one for each hypothesis, and the costs of its true pose and answer.

    A swarm is the costs of its particles in each round, the first one before any iteration. From
    the `chosen` one the answer was refined; without an answer, `answer_cost` is None.
    """

    title: str
    swarms: Sequence[Float[np.ndarray, "rounds particles"]]
    chosen: int | None
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
    if any(target.answer_cost is not None and target.chosen is None for target in targets):
        title += "\nno chosen swarm: the answer's search cannot be repeated, as after a closer look"
    figure.suptitle(title, fontsize=11)
    return figure


def _draw(ax: "Axes", target: SwarmsOfTarget) -> None:
    chosen = None if target.chosen is None else target.swarms[target.chosen]
    for costs in target.swarms:
        if costs is not chosen:
            ax.plot(_best(costs), color=_OTHER, linewidth=1.1, label=_REST)
    if chosen is not None:
        x = np.repeat(np.arange(len(chosen)), chosen.shape[1])
        ax.scatter(x, chosen.ravel(), s=3, color=_PARTICLES, alpha=0.5, label=_POINTS)
        ax.plot(_best(chosen), color=_CHOSEN, linewidth=2.2, label=_BEST)
    ax.axhline(target.true_cost, color=_TRUE, linewidth=1.5, ls="--", label=_TRUTH)
    if target.answer_cost is not None:
        last = max(map(len, target.swarms if chosen is None else [chosen])) - 1
        ax.plot(last, target.answer_cost, "*", color=_ANSWER, markersize=9, label=_FOUND)
    ax.set_title(target.title, fontsize=9)
    ax.set_xlabel("iteration")
    ax.margins(y=0.12)
    ax.set_ylim(bottom=0.0)
    ax.spines[["top", "right"]].set_visible(False)
    ax.grid(axis="y", alpha=0.3)


def _best(costs: Float[np.ndarray, "rounds particles"]) -> Float[np.ndarray, "rounds"]:
    """The lowest cost so far."""
    return np.asarray(np.minimum.accumulate(costs.min(axis=1)))
