import csv

from hlp.reporting.tables.repeats import (
    format_oracle,
    oracle_metrics,
    oracle_table,
    write_oracle,
)
from table_text import unpadded


def recall(share, targets=10):
    return {"targets": targets, "recall": share, "ci95": [share / 2, share]}


def cell(region, coarse, cat, cup):
    return {
        "region": region,
        "coarse": coarse,
        "fine": "estimated",
        "add": recall((cat + cup) / 2, 20),
        "per_object": {"cat": recall(cat), "cup": recall(cup)},
    }


RESULT = {
    "frames": 7,
    "noise_deg": 12.5,
    "noise_mm": 10.0,
    "cells": [cell("estimated", "estimated", 0.4, 0.2), cell("true", "noisy", 1.0, 0.8)],
    "lost": {"region": 0.125, "coarse pose": -0.01, "fine pose": 0.5},
}


def test_the_table_has_a_row_an_object_and_a_column_a_cell():
    table = oracle_table(RESULT)
    assert table.header == ["region/coarse", "targets", "est/est", "true/true±"]
    assert table.rows == [
        ["cat", "10", "0.400 (0.20-0.40)", "1.000 (0.50-1.00)"],
        ["cup", "10", "0.200 (0.10-0.20)", "0.800 (0.40-0.80)"],
        ["all targets", "20", "0.300 (0.15-0.30)", "0.900 (0.45-0.90)"],
    ]


def test_text_and_markdown_say_what_the_columns_and_the_losses_are(tmp_path):
    for text in (format_oracle(RESULT), format_oracle(RESULT, "markdown")):
        assert "7 frames" in text
        assert "12.5 degrees" in text and "10 mm" in text
        assert "region +0.125, coarse pose -0.010, fine pose +0.500" in text
    write_oracle(tmp_path, RESULT)
    written = unpadded((tmp_path / "oracle.md").read_text())
    assert "| cup | 10 | 0.200 (0.10-0.20) | 0.800 (0.40-0.80) |" in written.splitlines()


def test_csv_has_a_row_for_each_object_and_cell_in_full(tmp_path):
    write_oracle(tmp_path, RESULT)
    with (tmp_path / "oracle.csv").open(newline="") as stream:
        rows = list(csv.DictReader(stream))
    assert [row["object"] for row in rows] == ["cat", "cup", "all"] * 2
    assert rows[4] == {
        "object": "cup",
        "region": "true",
        "coarse": "noisy",
        "fine": "estimated",
        "targets": "10",
        "add_recall": "0.8",
        "ci95_low": "0.4",
        "ci95_high": "0.8",
    }


def test_metrics_are_flat_numbers():
    metrics = oracle_metrics(RESULT)
    assert metrics["oracle/region_true/coarse_noisy"] == 0.9
    assert metrics["oracle/lost/coarse pose"] == -0.01
