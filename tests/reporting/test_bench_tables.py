import copy
import json
from pathlib import Path

import pytest

from hlp.reporting.bench_tables import compare_benches, format_bench, read_bench
from table_text import unpadded
from written_bench import bench_path, bench_result


def cells(text: str, name: str) -> list[str]:
    """The numbers of the first row of that name, in a table for a terminal or in Markdown."""
    lines = [line.strip("| ").replace("|", " ") for line in text.splitlines()]
    (line,) = [line for line in lines if line.startswith(f"{name} ")][:1]
    return line.split()[len(name.split()) :]


def test_tables_state_the_machine_and_every_unit() -> None:
    text = format_bench(bench_result(), "markdown")
    for words in ("Quick 9000, 2 cores; threads: 2", "1 objects, 57600 codebook", "25 particles"):
        assert words in text
    row = ["10.0", "20.0", "15.0", "2.5", "5.0", "3.8", "20.0", "40.0", "30.0"]
    assert cells(text, "network") == row
    assert " ".join(cells(text, "reference")) == "x3.00 x3.00 x3.00 0.700 0.700"
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
    assert " ".join(cells(text, "network")) == "10.0 15.0 x1.50 2.5 3.8 x1.50 20.0 30.0 x1.50"
    assert cells(text, "ADD(-S) recall") == ["0.800", "0.750"]
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
