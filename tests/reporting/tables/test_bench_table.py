import copy
import json
from pathlib import Path
from typing import Any

import pytest

from hlp.reporting.tables.bench_table import (
    bench_metrics,
    compare_benches,
    format_bench,
    read_bench,
    write_bench,
)
from table_text import unpadded


def spreads(scale: float) -> dict[str, dict[str, float]]:
    times = {"network": 10.0, "stage 1": 10.0, "total": 10.0}
    return {
        part: {"median_ms": ms * scale, "p95_ms": 2 * ms * scale, "cpu_ms": 1.5 * ms * scale}
        for part, ms in times.items()
    }


def path(scale: float, recall: float) -> dict[str, Any]:
    views = {"first": spreads(scale), "further": spreads(scale / 4), "frame": spreads(2 * scale)}
    by_objects = {"1": {"median_ms": 10.0 * scale, "frames": 3}}
    return {"add_recall": recall, **views, "by_objects": by_objects}


def result() -> dict[str, Any]:
    ratio = {view: {"stage 1": 3.0, "total": 3.0} for view in ("first", "further", "frame")}
    agreed = {"same_pose": 0.9, "same_verdict": 0.95, "region_iou": 0.5}
    versions = {"python": "3", "torch": "2", "numba": "0", "numpy": "2"}
    return {
        "machine": {
            "cpu": "Quick 9000",
            "cores": 2,
            "memory_mib": 8192,
            "gpu": None,
            "load": 0.1,
            "threads": {"machine": 2, "torch": 2, "opencv": 2},
            "versions": versions,
        },
        "workload": {
            "experiment": "demo",
            "frames": 3,
            "image": [640, 480],
            "objects": {"cat": {"codebook_entries": 57600, "proxy_faces": 900}},
            "scan": "fast",
            "codebook": "inverted_lists",
            "refinement": "pso",
            "particles": 25,
            "refined": 8,
        },
        "loading_s": {
            "models": 1.0,
            "finding": 0.5,
            "classifier": 0.1,
            "encoder": 0.1,
            "objects": {"cat": 0.4},
        },
        "memory": {"peak_mib": 900.0, "all_paths_mib": 1000.0, "learnt_too": []},
        "paths": {"configured": path(1.0, 0.8), "reference": path(3.0, 0.7)},
        "compared": {"reference": {"changes": {}, "ratio": ratio, **agreed}},
        "tolerance": {"mm": 1.0, "deg": 0.5},
        "regions_of_all": {"objects": 15, "median_ms": 111.0, "p95_ms": 130.0, "cpu_ms": 200.0},
        "objects_at_once": {"median_ms": 17.0, "p95_ms": 30.0, "cpu_ms": 31.0},
        "search": {
            "queries": 170.0,
            "recall": 0.987,
            "recall_of_nearest": 0.99,
            "median_ms": 2.0,
            "exact_ms": 20.0,
            "ratio": 10.0,
        },
    }


def cells(text: str, name: str) -> list[str]:
    (line,) = [line for line in text.splitlines() if line.startswith(f"{name} ")][:1]
    return line.split()[len(name.split()) :]


def test_tables_state_the_machine_and_every_unit() -> None:
    text = format_bench(result())
    assert "Quick 9000, 2 cores, 8 GiB" in text and "57600" in text and "25 particles" in text
    row = ["10.0", "20.0", "15.0", "2.5", "5.0", "3.8", "20.0", "40.0", "30.0"]
    assert cells(text, "network") == row
    assert cells(text, "reference") == [
        "x3.00",
        "x3.00",
        "x3.00",
        "0.700",
        "0.900",
        "0.950",
        "0.500",
    ]
    assert "all 15 objects" in text and "111.0 ms" in text
    assert "17.0 ms (95 %: 30.0; CPU 31.0); one after another: 20.0 ms" in text
    assert "recall 0.987" in text and "each object 0.40" in text and "900 MiB" in text


def test_one_object_a_frame_has_no_further_ones(tmp_path: Path) -> None:
    alone = result()
    for each in alone["paths"].values():
        each["further"] = {}
    assert "each further" not in format_bench(alone)
    write_bench(tmp_path, alone)
    assert "| network | 10.0 |" in unpadded((tmp_path / "bench.md").read_text())
    assert "bench/configured/further/network" not in bench_metrics(alone)
    assert bench_metrics(alone)["bench/reference/frame/total"] == 60.0


def test_saved_results_are_divided_path_by_path(tmp_path: Path) -> None:
    slower = copy.deepcopy(result())
    slower["paths"] = {"configured": path(1.5, 0.75)}
    slower["workload"]["particles"] = 50
    for name, content in (("a", result()), ("b", slower)):
        (tmp_path / f"{name}.json").write_text(json.dumps(content))
    text = compare_benches(tmp_path / "a.json", tmp_path / "b.json")
    assert cells(text, "network") == [
        "10.0",
        "15.0",
        "x1.50",
        "2.5",
        "3.8",
        "x1.50",
        "20.0",
        "30.0",
        "x1.50",
    ]
    assert cells(text, "ADD(-S) recall") == ["0.800", "0.750"]
    assert "The two did not measure the same: particles 25 and 50." in text
    assert "'reference'" not in text


def test_a_file_that_is_no_bench_is_named(tmp_path: Path) -> None:
    path = tmp_path / "summary.json"
    path.write_text('{"paths": {}}')
    with pytest.raises(ValueError, match=r"summary\.json is no bench: it lacks machine, memory"):
        read_bench(path)
    path.write_text("{")
    with pytest.raises(ValueError, match=r"summary\.json is no JSON"):
        read_bench(path)
