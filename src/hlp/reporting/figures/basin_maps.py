"""Basins of refiners: recall against the error of the start, as heat maps, table and CSV."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Bool, Float

from hlp.files import read_csv, write_csv, write_text
from hlp.reporting.figures.saving import save_figure
from hlp.reporting.figures.sweep_grid import draw_cells
from hlp.reporting.tables.repeats import ALL_TARGETS, head_of
from hlp.reporting.tables.table import Table, lay_out, prose

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.image import AxesImage

Verdicts = Bool[np.ndarray, "n degrees millimetres"]
Recalls = Float[np.ndarray, "degrees millimetres"]

ALL = "all"
_COLUMNS = (
    "refiner",
    "object",
    "rotation_deg",
    "translation_mm",
    "perturbations",
    "right",
    "add_recall",
)
_CELL = 0.62  # inches


@dataclass(frozen=True)
class Basins:
    """Verdicts of ADD(-S) after refinement for each pair of errors: `right[refiner][object]`.

    All refiners were given the same perturbations.
    """

    rotation_deg: tuple[float, ...]
    translation_mm: tuple[float, ...]
    right: Mapping[str, Mapping[str, Verdicts]]

    def with_all(self, refiner: str) -> dict[str, Verdicts]:
        """One refiner's verdicts by object; first those of all objects together."""
        verdicts = self.right[refiner]
        return {ALL: np.concatenate(list(verdicts.values())), **verdicts}


def write_basins(folder: Path, basins: Basins) -> None:
    """Write basin.md, and basin.csv: a row a refiner, object and pair of starting errors."""
    write_text(folder / "basin.md", format_basins(basins, "markdown") + "\n")
    rows = []
    for refiner in basins.right:
        for name, verdicts in basins.with_all(refiner).items():
            for i, degrees in enumerate(basins.rotation_deg):
                for j, millimetres in enumerate(basins.translation_mm):
                    tried, right = len(verdicts), int(verdicts[:, i, j].sum())
                    cell = (refiner, name, degrees, millimetres)
                    rows.append([*cell, tried, right, right / tried])
    write_csv(folder / "basin.csv", _COLUMNS, rows)


def read_mean_recalls(path: Path) -> dict[str, float]:
    """Recall of all objects by refiner, the mean over all starting errors, from basin.csv.

    Raises MissingFileError, DataError for another file, and ValueError for a cell that is no
    number.
    """
    recalls: dict[str, list[float]] = {}
    for row in read_csv(path, _COLUMNS):
        if row["object"] == ALL:
            recalls.setdefault(row["refiner"], []).append(float(row["add_recall"]))
    return {refiner: sum(each) / len(each) for refiner, each in recalls.items()}


def format_basins(basins: Basins, layout: str = "text") -> str:
    """Tables for people (`text` or `markdown`): recall by pair of errors, and means per object."""
    caption = (
        "ADD(-S) recall after refinement, by the error of the start: a row for each rotation"
        " (degrees), a column for each translation (mm)."
    )
    parts = [prose(caption, layout)]
    for refiner in basins.right:
        recalls = basins.with_all(refiner)[ALL].mean(axis=0)
        rows = [
            [f"{degrees:g}", *(f"{value:.2f}" for value in row)]
            for degrees, row in zip(basins.rotation_deg, recalls, strict=True)
        ]
        table = Table([refiner, *(f"{mm:g}" for mm in basins.translation_mm)], rows)
        parts.append(lay_out(table, layout))
    means = {refiner: basins.with_all(refiner) for refiner in basins.right}
    rows = [
        [name, str(len(verdicts)), *(f"{means[refiner][name].mean():.3f}" for refiner in means)]
        for name, verdicts in next(iter(means.values())).items()
    ]
    parts.append("Mean over all starting errors:")
    parts.append(lay_out(Table(["object", "perturbations each", *means], rows), layout))
    return "\n\n".join(parts)


def basin_metrics(basins: Basins) -> dict[str, float | None]:
    """Flat numbers for MLflow: the mean recall of each refiner and object, `basin/pso/cat`."""
    return {
        f"basin/{refiner}/{name}": float(verdicts.mean())
        for refiner in basins.right
        for name, verdicts in basins.with_all(refiner).items()
    }


def draw_basins(folder: Path, basins: Basins) -> None:
    """Write NAME.png and NAME.svg for every object and for all: one heat map for each refiner."""
    folder.mkdir(parents=True, exist_ok=True)
    by_refiner = {refiner: basins.with_all(refiner) for refiner in basins.right}
    for name in next(iter(by_refiner.values())):
        verdicts = {refiner: objects[name] for refiner, objects in by_refiner.items()}
        save_figure(heat_maps(name, basins, verdicts), folder / name)


def heat_maps(name: str, basins: Basins, verdicts: Mapping[str, Verdicts]) -> "Figure":
    """Heat maps of the refiners side by side, with the recall written into every cell."""
    from matplotlib.figure import Figure

    rows, columns = len(basins.rotation_deg), len(basins.translation_mm)
    width = _CELL * columns * len(verdicts) + 1.6
    figure = Figure(figsize=(width, _CELL * rows + 1.3), layout="constrained")
    axes = figure.subplots(1, len(verdicts), sharey=True, squeeze=False)[0]
    for ax, (refiner, found) in zip(axes, verdicts.items(), strict=True):
        image = _heat_map(ax, basins, found.mean(axis=0))
        ax.set_title(refiner)
    axes[0].set_ylabel("starting rotation error (degrees)")
    figure.colorbar(image, ax=axes, label="ADD(-S) recall")
    tried = len(next(iter(verdicts.values())))
    figure.suptitle(f"{name}: recall after refinement, {tried} perturbations a cell")
    return figure


def _heat_map(ax: "Axes", basins: Basins, recalls: Recalls) -> "AxesImage":
    image = draw_cells(ax, recalls, "viridis", "{:.2f}", (0.0, 1.0))
    ax.set_ylim(-0.5, len(recalls) - 0.5)  # the smallest error at the bottom
    ax.set_xticks(range(recalls.shape[1]), [f"{mm:g}" for mm in basins.translation_mm])
    ax.set_yticks(range(recalls.shape[0]), [f"{degrees:g}" for degrees in basins.rotation_deg])
    ax.set_xlabel("translation error (mm)")
    return image


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
