"""Heat maps: sweeps of two settings, basins of refiners, the oracle matrix."""

from pathlib import Path

import cv2
import numpy as np
import pandas as pd

from hlp.reporting.figures.heat_maps import (
    HeatMap,
    basin_maps,
    draw_basins,
    draw_heat_maps,
    oracle_map,
)


def test_there_is_a_picture_and_a_drawing_for_each_object_and_all(
    basins: pd.DataFrame, tmp_path: Path
) -> None:
    draw_basins(tmp_path, basins)
    names = {f"{name}.{kind}" for name in ("all", "cat", "cup") for kind in ("png", "svg")}
    assert {path.name for path in (tmp_path).iterdir()} == names
    pictures = [cv2.imread(str(tmp_path / f"{name}.png")) for name in ("cat", "cup")]
    assert pictures[0].shape[1] > 500 and not np.array_equal(*pictures)


def test_a_map_of_basins_shows_the_recalls_with_degrees_upwards(basins: pd.DataFrame) -> None:
    figure = basin_maps("cat", basins[basins["object"] == "cat"])
    pso, icp = figure.axes
    assert (pso.get_title(), icp.get_title()) == ("pso", "icp")
    np.testing.assert_allclose(pso.images[0].get_array(), [[0.5, 0.25, 0], [1, 0.75, 0.25]])
    assert pso.images[0].get_clim() == (0.0, 1.0)
    assert [label.get_text() for label in pso.get_yticklabels()] == ["15", "0"]
    assert [label.get_text() for label in pso.get_xticklabels()] == ["0", "10", "50"]
    written = {text.get_position(): text.get_text() for text in icp.texts}
    assert written[1, 1] == "1.00" and written[2, 1] == "0.00" and len(written) == 6
    assert figure.get_suptitle() == "cat: recall after refinement, 4 perturbations a cell"


def test_cells_without_a_result_and_the_default_say_so() -> None:
    values = np.array([[1.0, 2.0], [3.0, np.nan]])
    maps, axes = [HeatMap("ms", values, "{:.0f}".format)], ("across", "down")
    figure = draw_heat_maps(maps, ["x", "y"], ["a", "b"], axes, "", (1, 0))
    (ax,) = figure.axes
    assert [text.get_text() for text in ax.texts] == ["1", "2", "3\n(default)", "no result"]


def test_the_oracle_matrix_has_a_row_an_object_and_a_column_a_cell() -> None:
    recalls = np.array([[0.25, 0.5], [1.0, 0.0], [0.625, 0.25]])  # cat, can, all targets
    matrix = [
        {
            "region": region,
            "coarse": "true",
            "add": {"recall": recalls[2, column]},
            "per_object": {
                name: {"recall": recalls[row, column]} for row, name in enumerate(("cat", "can"))
            },
        }
        for column, region in enumerate(("estimated", "true"))
    ]
    lost = {"region": 0.01, "coarse pose": -0.02}
    figure = oracle_map({"frames": 3, "cells": matrix, "lost": lost})
    (ax,) = figure.axes
    np.testing.assert_array_equal(ax.images[0].get_array(), recalls)
    assert ax.images[0].get_clim() == (0.0, 1.0)
    assert [text.get_text() for text in ax.texts] == [f"{recall:.3f}" for recall in recalls.ravel()]
    assert [label.get_text() for label in ax.get_xticklabels()] == ["est/true", "true/true"]
    assert [label.get_text() for label in ax.get_yticklabels()] == ["cat", "can", "all targets"]
    title = figure.get_suptitle()
    assert title.endswith("Lost by each stage: region +0.010, coarse pose -0.020")
