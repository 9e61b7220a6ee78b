"""The table of a sweep of benches."""

import csv
import json
from pathlib import Path
from typing import Any

import pytest

from hlp.errors import DataError
from hlp.reporting.bench_sweep import describe_benches, write_benches
from hlp.reporting.report import report_runs
from written_results import scored, write_run, write_sweep


def write_arm(folder: Path, particles: int, further: bool = True) -> None:
    """An arm of which detection takes a millisecond a particle."""
    (folder / ".hydra").mkdir(parents=True)
    given = ["task=bench", f"refinement.particles={particles}"]
    (folder / ".hydra" / "overrides.yaml").write_text(json.dumps(given))
    path: dict[str, Any] = {
        "add_recall": 0.75,
        "first": {"total": {"median_ms": float(particles), "cpu_ms": 2.0 * particles}},
        "further": {"total": {"median_ms": particles / 4, "cpu_ms": particles / 2}},
    }
    result = {
        "machine": {},
        "workload": {},
        "memory": {"peak_mib": 912.3},
        "paths": {"configured": path if further else {**path, "further": {}}},
    }
    (folder / "bench.json").write_text(json.dumps(result))


@pytest.fixture
def benches(tmp_path: Path) -> Path:
    sweep = write_sweep(tmp_path / "sweep", ["refinement.particles"], ["task=bench", "a=1,2"])
    for arm, particles in enumerate((15, 150)):
        write_arm(sweep / str(arm), particles, further=arm == 0)
    (sweep / "10" / ".hydra").mkdir(parents=True)  # stopped
    (sweep / "10" / ".hydra" / "overrides.yaml").write_text('["refinement.particles=50"]')
    return sweep


def test_every_arm_has_a_row_with_what_differs(benches: Path) -> None:
    said = describe_benches(benches, "text")
    header, _, *rows = (line.split() for line in said.split("\n\n")[0].splitlines())
    assert header[0] == "particles"
    assert rows == [
        ["15", "15.0", "3.8", "30.0", "7.5", "912", "0.750"],
        ["150", "150", "300", "912", "0.750"],
        ["50", "no", "result"],
    ]
    assert max(map(len, said.splitlines())) <= 80


def test_the_table_is_written_and_reported(benches: Path) -> None:
    markdown, table = write_benches(benches)
    assert "Made by `hlp bench -m a=1,2`." in markdown.read_text()
    with table.open(newline="") as stream:
        assert [row["MiB"] for row in csv.DictReader(stream)] == ["912", "912", ""]
    report = report_runs(benches.parent, "text")
    assert describe_benches(benches, "text") in report and "bench.csv" in report


def test_other_sweeps_have_none(tmp_path: Path) -> None:
    sweep = write_sweep(tmp_path / "sweep", ["seed"], ["seed=1"])
    write_run(sweep / "0", "demo", scored(0.5, 40.0, {"cat": 0.5}))
    assert describe_benches(sweep, "text") == ""
    assert write_benches(sweep) == []
    assert not list(sweep.glob("bench.*"))


def test_a_broken_bench_is_named(benches: Path) -> None:
    (benches / "1" / "bench.json").write_text("{")
    with pytest.raises(DataError, match=r"1/bench\.json"):
        describe_benches(benches, "text")
    (benches / "1" / "bench.json").write_text(
        '{"machine": 1, "workload": 1, "memory": 1, "paths": {"configured": 1}}'
    )
    with pytest.raises(DataError, match=r"1/bench\.json is no bench"):
        describe_benches(benches, "text")
