"""Heat maps: sweeps of two settings, basins and the oracle matrix."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd
from jaxtyping import Float

from hlp.reporting.figures import new_figure, save_figure
from hlp.reporting.study_tables import ALL_TARGETS, head_of, recalls_by_errors

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_CELL = (0.62, 0.42)  # inches


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

    The `marked` row and column are those of the defaults.
    """
    width = max(_CELL[0] * len(columns) * len(maps) + 2.2, 5.4)
    figure = new_figure(width, max(_CELL[1] * len(rows) + 1.7, 2.8))
    panels = figure.subplots(1, len(maps), sharey=True, squeeze=False)[0]
    for ax, heat_map in zip(panels, maps, strict=True):
        _draw_map(ax, heat_map, marked)
        turned = {"rotation": 45, "ha": "right"} if max(map(len, columns)) > 9 else {}
        ax.set_xticks(range(len(columns)), columns, fontsize=8, **turned)
        ax.set_yticks(range(len(rows)), rows, fontsize=8)
        ax.set_xlabel(axes[0], fontsize=8)
        ax.set_title(heat_map.title, fontsize=9)
    panels[0].set_ylabel(axes[1], fontsize=8)
    figure.suptitle(title, fontsize=10)
    return figure


def _draw_map(ax: "Axes", given: HeatMap, marked: tuple[int, int] | None) -> None:
    from matplotlib.patheffects import withStroke

    low, high = given.ends
    ax.imshow(given.values, cmap=given.colors, aspect="auto", vmin=low, vmax=high)
    for (row, column), value in np.ndenumerate(given.values):
        words = "no result" if np.isnan(value) else given.write(value)
        words += "\n(default)" if (row, column) == marked else ""
        text = ax.text(column, row, words, ha="center", va="center", fontsize=8, color="white")
        text.set_path_effects([withStroke(linewidth=1.5, foreground="black")])


def draw_basins(folder: Path, cells: pd.DataFrame) -> None:
    """Write NAME.png and NAME.svg for every object and for all: a map for each refiner."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, own in cells.groupby("object", sort=False):
        save_figure(basin_maps(str(name), own), folder / str(name))


def basin_maps(name: str, cells: pd.DataFrame) -> "Figure":
    """Recall of each refiner by both errors of the start, the smallest rotation at the bottom."""
    groups = cells.groupby("refiner", sort=False)
    refiners = {refiner: recalls_by_errors(own) for refiner, own in groups}
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
