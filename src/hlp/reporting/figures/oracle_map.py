"""The oracle matrix as a picture: recall of each object in each cell."""

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from hlp.reporting.figures.saving import save_figure
from hlp.reporting.figures.sweep_grid import draw_cells
from hlp.reporting.tables.oracle_table import ALL_TARGETS, head_of

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_ROW = 0.32  # inches


def draw_oracle(folder: Path, result: Mapping[str, Any]) -> list[Path]:
    """Write oracle.png and oracle.svg, given what oracle.json holds; those files."""
    return save_figure(oracle_map(result), folder / "oracle")


def oracle_map(result: Mapping[str, Any]) -> "Figure":
    """ADD(-S) recall: a row an object and one for all targets, a column a cell of the matrix."""
    from matplotlib.figure import Figure

    cells = result["cells"]
    names = [*cells[0]["per_object"], ALL_TARGETS]
    found = [{**cell["per_object"], ALL_TARGETS: cell["add"]} for cell in cells]
    recalls = np.array([[each[name]["recall"] for each in found] for name in names], dtype=float)
    figure = Figure(figsize=(7.0, _ROW * len(names) + 1.5), layout="constrained")
    ax = figure.subplots()
    draw_cells(ax, recalls, "viridis", "{:.3f}", (0.0, 1.0))
    ax.axhline(len(names) - 1.5, color="white", linewidth=3)
    ax.set_xticks(range(len(cells)), [head_of(cell) for cell in cells], fontsize=8)
    ax.set_yticks(range(len(names)), names, fontsize=8)
    ax.set_xlabel("region/coarse pose: estimated, true, true± (turned and shifted)", fontsize=8)
    lost = ", ".join(f"{stage} {share:+.3f}" for stage, share in result["lost"].items())
    figure.suptitle(
        f"ADD(-S) recall of {result['frames']} frames\nLost by each stage: {lost}",
        fontsize=9.5, x=0.01, ha="left",
    )  # fmt: skip
    return figure
