"""Heat maps: sweeps of two settings, basins, the oracle matrix; and a search's trials as points."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd
from jaxtyping import Float

from hlp.reporting.figures import save_figure
from hlp.reporting.figures.charts import time_axes
from hlp.reporting.study_tables import ALL_TARGETS, head_of, recalls_by_errors

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_CELL = (0.62, 0.42)  # inches
_WITHIN, _OVER, _BEST = "#0072b2", "#999999", "#d55e00"
_BRIGHT = 0.55  # luminance from which numbers are black


@dataclass(frozen=True)
class HeatMap:
    """Values and how they are written into their cells; NaN is said to be no result.

    `ends` are the values of the darkest and the brightest colour (None: those of the data).
    """

    title: str
    values: Float[np.ndarray, "rows columns"]
    write: Callable[[float], str] = "{:.3f}".format
    colors: str = "viridis"
    ends: tuple[float | None, float | None] = (None, None)


def draw_heat_maps(
    maps: Sequence[HeatMap],
    rows: Sequence[str],
    columns: Sequence[str],
    axes: tuple[str, str],
    title: str,
    marked: tuple[int, int] | None = None,
) -> "Figure":
    """The maps side by side; `axes` name the columns and the rows.

    The cell in the `marked` row and column, that of the defaults, has a frame.
    """
    from matplotlib.figure import Figure
    from matplotlib.patches import Rectangle

    width = max(_CELL[0] * len(columns) * len(maps) + 2.2, 5.4)
    figure = Figure(figsize=(width, max(_CELL[1] * len(rows) + 1.7, 2.8)), layout="constrained")
    panels = figure.subplots(1, len(maps), sharey=True, squeeze=False)[0]
    for ax, heat_map in zip(panels, maps, strict=True):
        _draw_map(ax, heat_map)
        turned = {"rotation": 45, "ha": "right"} if max(map(len, columns)) > 9 else {}
        ax.set_xticks(range(len(columns)), columns, fontsize=8, **turned)
        ax.set_yticks(range(len(rows)), rows, fontsize=8)
        ax.set_xlabel(axes[0], fontsize=8)
        ax.set_title(heat_map.title, fontsize=9)
        if marked is not None:
            row, column = marked
            frame = Rectangle((column - 0.47, row - 0.47), 0.94, 0.94, fill=False)
            ax.add_patch(frame).set(color="#d55e00", linewidth=2.5)
            ax.text(column, row + 0.36, "default", ha="center", va="center", fontsize=7,
                    color="#d55e00", backgroundcolor="white")  # fmt: skip
    panels[0].set_ylabel(axes[1], fontsize=8)
    figure.suptitle(title, fontsize=10)
    return figure


def _draw_map(ax: "Axes", given: HeatMap) -> None:
    image = ax.imshow(given.values, cmap=given.colors, aspect="auto", vmin=given.ends[0],
                      vmax=given.ends[1])  # fmt: skip
    for (row, column), value in np.ndenumerate(given.values):
        words, color = "no result", "0.5"
        if not np.isnan(value):
            red, green, blue, _ = image.cmap(image.norm(value))
            bright = 0.299 * red + 0.587 * green + 0.114 * blue > _BRIGHT
            words, color = given.write(value), "black" if bright else "white"
        ax.text(column, row, words, ha="center", va="center", fontsize=8, color=color)


def draw_basins(folder: Path, cells: pd.DataFrame) -> None:
    """Write NAME.png and NAME.svg for every object and for all: a map for each refiner."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, own in cells.groupby("object", sort=False):
        save_figure(basin_maps(str(name), own), folder / str(name))


def basin_maps(name: str, cells: pd.DataFrame) -> "Figure":
    """Recall of each refiner by both errors of the start, the smallest rotation at the bottom."""
    refiners = {
        refiner: recalls_by_errors(own) for refiner, own in cells.groupby("refiner", sort=False)
    }
    first = next(iter(refiners.values()))
    maps = [
        HeatMap(str(refiner), recalls.to_numpy()[::-1], "{:.2f}".format, ends=(0.0, 1.0))
        for refiner, recalls in refiners.items()
    ]
    rows, columns = ([f"{error:g}" for error in axis] for axis in (first.index[::-1], first))
    axes = ("translation error (mm)", "starting rotation error (degrees)")
    tried = cells["perturbations"].iloc[0]
    title = f"{name}: recall after refinement, {tried} perturbations a cell"
    return draw_heat_maps(maps, rows, columns, axes, title)


def oracle_map(result: Mapping[str, Any]) -> "Figure":
    """ADD(-S) recall: a row an object and one for all targets, a column a cell of the matrix."""
    found = [{**cell["per_object"], ALL_TARGETS: cell["add"]} for cell in result["cells"]]
    names = [*found[0]]
    recalls = np.array([[cell[name]["recall"] for cell in found] for name in names], dtype=float)
    axes = ("region/coarse pose: estimated, true", "")
    lost = ", ".join(f"{stage} {share:+.3f}" for stage, share in result["lost"].items())
    title = f"ADD(-S) recall of {result['frames']} frames\nLost by each stage: {lost}"
    columns = [head_of(cell["region"], cell["coarse"]) for cell in result["cells"]]
    return draw_heat_maps([HeatMap("", recalls, ends=(0.0, 1.0))], names, columns, axes, title)


def search_points(result: Mapping[str, Any]) -> "Figure":
    """A point for each trial with a result, of what `search.json` holds; there must be one.

    The first is the unchanged configuration.
    """
    limit, best = result["limit_ms"], result["best"]
    trials = [trial for trial in result["trials"] if trial["error"] is None]
    points = [(trial["time_ms"], trial["recall"]) for trial in trials]
    end = 1.1 * max(limit, *(time for time, _ in points))
    figure, ax = time_axes(points, end, f"{len(trials)} trials of {result['space']}")
    ax.axvline(limit, color="0.2", linewidth=1, linestyle=":", label=f"limit {limit:g} ms")
    colors = [_WITHIN if time <= limit else _OVER for time, _ in points]
    times, recalls = zip(*points, strict=True)
    ax.scatter(times, recalls, 26, colors, zorder=3)
    if best is not None:
        words = f"best within the limit: trial {best['trial']}"
        ax.plot(best["time_ms"], best["recall"], "*", color=_BEST, markersize=14, zorder=4,
                label=words)  # fmt: skip
    for trial, point in zip(trials, points, strict=True):
        if trial["trial"] == 0:
            ax.annotate("unchanged configuration", point, (8, -12), textcoords="offset points",
                        fontsize=8)  # fmt: skip
    figure.legend(loc="outside lower center", ncols=3, frameon=False, fontsize=8)
    return figure
