import csv

import cv2
import numpy as np
import pytest

from hlp.reporting.figures.basin_maps import (
    Basins,
    basin_metrics,
    draw_basins,
    format_basins,
    heat_maps,
    write_basins,
)

DEGREES, MILLIMETRES = (0.0, 15.0), (0.0, 10.0, 50.0)


def verdicts(count, right):
    """`right[i][j]` of `count` starts are right in each cell."""
    found = np.zeros((count, 2, 3), dtype=bool)
    for cell in np.ndindex(2, 3):
        found[: right[cell[0]][cell[1]], cell[0], cell[1]] = True
    return found


BASINS = Basins(
    DEGREES,
    MILLIMETRES,
    {
        "pso": {"cat": verdicts(4, [[4, 3, 1], [2, 1, 0]]), "cup": verdicts(2, [[2, 2, 2]] * 2)},
        "icp": {"cat": verdicts(4, [[4, 4, 0], [0, 0, 0]]), "cup": verdicts(2, [[1, 1, 1]] * 2)},
    },
)


@pytest.fixture(scope="module")
def maps(tmp_path_factory):
    folder = tmp_path_factory.mktemp("maps")
    draw_basins(folder / "heatmaps", BASINS)
    return folder / "heatmaps"


def test_csv_counts_every_cell(tmp_path):
    write_basins(tmp_path, BASINS)
    with (tmp_path / "basin.csv").open(newline="") as stream:
        rows = list(csv.DictReader(stream))
    assert len(rows) == 2 * 3 * 6
    cells = {(r["refiner"], r["object"], r["rotation_deg"], r["translation_mm"]): r for r in rows}
    found = cells["pso", "cat", "15.0", "10.0"]
    assert (found["perturbations"], found["right"], float(found["add_recall"])) == ("4", "1", 0.25)
    both = cells["pso", "all", "0.0", "10.0"]
    assert (both["perturbations"], both["right"]) == ("6", "5")  # of 4 + 2 starts, not of 2 objects


def test_tables_show_both_errors_and_the_objects():
    said = format_basins(BASINS).splitlines()
    at = [line.split() for line in said].index(["pso", "0", "10", "50"])
    assert said[at + 2].split() == ["0", "1.00", "0.83", "0.50"]
    assert said[at + 3].split() == ["15", "0.67", "0.50", "0.33"]
    assert ["cat", "4", "0.458", "0.333"] in [line.split() for line in said]
    assert ["all", "6", "0.639", "0.389"] in [line.split() for line in said]


def test_metrics_are_mean_recalls():
    metrics = basin_metrics(BASINS)
    assert metrics["basin/pso/cup"] == 1.0
    assert metrics["basin/icp/cat"] == pytest.approx(8 / 24)
    assert metrics["basin/icp/all"] == pytest.approx(14 / 36)


def test_there_is_a_picture_and_a_drawing_for_each_object_and_all(maps):
    names = {f"{name}.{kind}" for name in ("all", "cat", "cup") for kind in ("png", "svg")}
    assert {path.name for path in maps.iterdir()} == names
    pictures = [cv2.imread(str(maps / f"{name}.png")) for name in ("cat", "cup")]
    assert pictures[0].shape[1] > 500 and not np.array_equal(*pictures)


def test_equal_maps_are_equal_files(maps, tmp_path):
    draw_basins(tmp_path, BASINS)
    for path in maps.iterdir():
        assert path.read_bytes() == (tmp_path / path.name).read_bytes(), path.name


def test_a_heat_map_shows_the_recalls_with_degrees_upwards():
    own = {refiner: objects["cat"] for refiner, objects in BASINS.right.items()}
    pso, icp, _ = heat_maps("cat", BASINS, own).axes
    assert (pso.get_title(), icp.get_title()) == ("pso", "icp")
    np.testing.assert_allclose(pso.images[0].get_array(), [[1, 0.75, 0.25], [0.5, 0.25, 0]])
    assert pso.images[0].get_clim() == (0.0, 1.0)
    assert pso.get_ylim()[0] < pso.get_ylim()[1]  # 0 degrees at the bottom
    assert [label.get_text() for label in pso.get_yticklabels()] == ["0", "15"]
    assert [label.get_text() for label in pso.get_xticklabels()] == ["0", "10", "50"]
    written = {text.get_position(): text.get_text() for text in icp.texts}
    assert written[1, 0] == "1.00" and written[2, 0] == "0.00" and len(written) == 6
