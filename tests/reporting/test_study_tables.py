"""Tables and CSV files of the oracle, the basins and the search."""

import copy
import json
from pathlib import Path
from typing import Any

import pandas as pd
import pytest

from hlp.reporting.study_tables import (
    compare_benches,
    format_basins,
    format_bench,
    format_oracle,
    format_search,
    oracle_table,
    read_bench,
    write_basins,
    write_search,
)
from table_text import csv_rows, unpadded
from written_bench import bench_path, bench_result


def recall(share: float, targets: int = 10) -> dict[str, Any]:
    return {"targets": targets, "recall": share, "ci95": [share / 2, share]}


def cell(region: str, coarse: str, cat: float, cup: float) -> dict[str, Any]:
    return {
        "region": region,
        "coarse": coarse,
        "add": recall((cat + cup) / 2, 20),
        "per_object": {"cat": recall(cat), "cup": recall(cup)},
    }


ORACLE = {
    "frames": 7,
    "cells": [cell("estimated", "estimated", 0.4, 0.2), cell("true", "true", 1.0, 0.8)],
    "lost": {"region": 0.125, "coarse pose": -0.01, "fine pose": 0.5},
}


def test_the_oracle_has_a_row_an_object_and_a_column_a_cell() -> None:
    table = oracle_table(ORACLE)
    assert table.header == ["region/coarse", "targets", "est/est", "true/true"]
    assert table.rows == [
        ["cat", "10", "0.400 (0.20-0.40)", "1.000 (0.50-1.00)"],
        ["cup", "10", "0.200 (0.10-0.20)", "0.800 (0.40-0.80)"],
        ["all targets", "20", "0.300 (0.15-0.30)", "0.900 (0.45-0.90)"],
    ]
    for text in (format_oracle(ORACLE), format_oracle(ORACLE, "markdown")):
        assert "7 frames" in text
        assert "region +0.125, coarse pose -0.010, fine pose +0.500" in text
    written = unpadded(format_oracle(ORACLE, "markdown"))
    assert "| cup | 10 | 0.200 (0.10-0.20) | 0.800 (0.40-0.80) |" in written.splitlines()


def test_basins_count_every_cell_in_the_order_of_the_study(
    basins: pd.DataFrame, tmp_path: Path
) -> None:
    write_basins(tmp_path, basins)
    rows = csv_rows(tmp_path / "basin.csv")
    assert len(rows) == 2 * 3 * 6
    order = [(row["refiner"], row["object"]) for row in rows[::6]]
    assert order == [
        (refiner, name) for refiner in ("pso", "icp") for name in ("all", "cup", "cat")
    ]
    found = {(r["refiner"], r["object"], r["rotation_deg"], r["translation_mm"]): r for r in rows}
    one = found["pso", "cat", "15.0", "10.0"]
    assert (one["perturbations"], one["right"], float(one["add_recall"])) == ("4", "1", 0.25)
    both = found["pso", "all", "0.0", "10.0"]
    assert (both["perturbations"], both["right"]) == ("6", "5")  # of 4 + 2 starts, not of 2 objects
    said = [line.split() for line in format_basins(basins).splitlines()]
    at = said.index(["pso", "0", "10", "50"])
    assert said[at + 2] == ["0", "1.00", "0.83", "0.50"]
    assert said[at + 3] == ["15", "0.67", "0.50", "0.33"]
    assert ["object", "perturbations", "each", "pso", "icp"] in said
    assert ["cat", "4", "0.458", "0.333"] in said and ["all", "6", "0.639", "0.389"] in said


def trial(
    number: int, particles: int, recall: float | None, ms: float | None, error: str | None = None
) -> dict[str, Any]:
    values = {"refinement.particles": particles, "refinement.theta_deg": 5.0 + number / 3.0}
    found = {"recall": recall, "time_ms": ms, "error": error, "folder": str(number)}
    return {"trial": number, "values": values, **found}


TRIALS = [
    trial(0, 25, 0.8, 90.0),
    trial(1, 50, 0.9, 130.0),
    trial(2, 10, None, None, "no depth"),
    trial(3, 20, 0.8, 70.0),
]
TRIALS[1]["values"] = dict(reversed(TRIALS[1]["values"].items()))  # Optuna promises no order
SEARCH = {"space": "refinement", "limit_ms": 100.0, "best": TRIALS[3], "trials": TRIALS}


def test_trials_are_ranked_within_the_limit_first(tmp_path: Path) -> None:
    table = unpadded(format_search(SEARCH, "markdown")).splitlines()
    assert table[0].startswith("4 trials of refinement, 3 of them with a result")
    assert table[4:7] == [
        "| 3 | 0.800 | 70 | 20 | 6 |",
        "| 0 | 0.800 | 90 | 25 | 5 |",
        "| 1 | 0.900 | 130 (over) | 50 | 5.33 |",
    ]
    assert table[-1] == "Best within the limit: refinement.particles=20 refinement.theta_deg=6.0"
    assert format_search({**SEARCH, "best": None}).endswith("No trial within 100 ms.")
    write_search(tmp_path, SEARCH)
    rows = csv_rows(tmp_path / "search.csv")
    assert [row["refinement.particles"] for row in rows] == ["25", "50", "10", "20"]
    assert [row["add_recall"] for row in rows] == ["0.8", "0.9", "", "0.8"]
    assert [row["error"] for row in rows] == ["", "", "no depth", ""]
    assert float(rows[1]["refinement.theta_deg"]) == 5.0 + 1 / 3.0
    assert (tmp_path / "search.md").read_text() == format_search(SEARCH, "markdown") + "\n"


def cells(text: str, name: str) -> list[str]:
    """The numbers of the first row of that name, in a table for a terminal or in Markdown."""
    lines = [line.strip("| ").replace("|", " ") for line in text.splitlines()]
    (line,) = [line for line in lines if line.startswith(f"{name} ")][:1]
    return line.split()[len(name.split()) :]


def test_tables_state_the_machine_and_every_unit() -> None:
    text = format_bench(bench_result(), "markdown")
    for words in (
        "Quick 9000, 2 cores; threads: 2",
        "objects 1, codebook entries 57600",
        "particles 25",
    ):
        assert words in text
    row = ["10.0", "20.0", "15.0", "2.5", "5.0", "3.8", "20.0", "40.0", "30.0"]
    assert cells(text, "network") == row
    assert " ".join(cells(text, "reference")) == "30.0 x3.00 30.0 x3.00 60.0 x3.00 0.700 0.700"
    assert "each object 0.40" in text and "900 MiB" in text


def test_one_object_a_frame_has_no_further_ones() -> None:
    alone = bench_result()
    for path in alone["paths"].values():
        path["further"] = {}
    assert "part first 95 % CPU frame 95 % CPU" in " ".join(format_bench(alone).split())
    assert "| network | 10.0 |" in unpadded(format_bench(alone, "markdown"))


def test_saved_results_are_divided_path_by_path(tmp_path: Path) -> None:
    slower = copy.deepcopy(bench_result())
    slower["paths"] = {"configured": bench_path(1.5, 0.75)}
    slower["workload"]["particles"] = 50
    for name, content in (("a", bench_result()), ("b", slower)):
        (tmp_path / f"{name}.json").write_text(json.dumps(content))
    text = compare_benches(tmp_path / "a.json", tmp_path / "b.json")
    assert " ".join(cells(text, "B   ")) == "15.0 x1.50 15.0 x1.50 30.0 x1.50 0.750"
    assert "The two did not measure the same: particles 25 and 50." in text
    assert "'reference'" not in text


def test_a_file_that_is_no_bench_is_named(tmp_path: Path) -> None:
    path = tmp_path / "summary.json"
    path.write_text('{"paths": {}}')
    with pytest.raises(ValueError, match=r"summary\.json is no bench: it lacks machine, memory"):
        read_bench(path)
    path.write_text("{")
    with pytest.raises(ValueError, match=r"summary\.json is not JSON"):
        read_bench(path)
