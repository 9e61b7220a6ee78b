"""What sweeps of studies end with: tables, figures, pages."""

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from hlp.errors import DataError
from hlp.reporting.page import write_sweep_page
from hlp.reporting.report import report_runs, write_pages
from hlp.reporting.study_tables import basin_cells, write_basins
from hlp.reporting.sweep_report import describe_sweep, sweep_table
from hlp.reporting.sweep_report import write_sweep as write_files
from hlp.reporting.sweeps import read_sweeps
from hlp.results.recalls import blocks_of, difference_interval, write_target_values
from table_text import csv_rows
from written_results import write_sweep
from written_sweeps import (
    PARTICLES,
    begin,
    change,
    only,
    set_default,
    write_scored,
    write_three_runs,
)


def begin_study(folder: Path, task: str, particles: int, finished: bool = True) -> Path:
    begin(folder, f"task={task}", f"{PARTICLES}={particles}")
    if finished:
        manifest = {
            "config": {"task": {"name": task}, "data": {"name": "synthetic"}},
            "data": {"keys": ["000001"], "frames": "abc"},
        }
        (folder / "manifest.json").write_text(json.dumps(manifest))
        (folder / f"{task}.md").write_text("A table.\n")
    return folder


def write_oracle(folder: Path, particles: int) -> None:
    recall = particles / 100
    cells = [
        {"region": region, "coarse": coarse, "add": {"recall": recall, "ci95": [0.1, 0.9]}}
        for region in ("estimated", "true")
        for coarse in ("estimated", "true")
    ]
    lost = {"region": 0.01, "coarse pose": -0.02, "fine pose": 0.1}
    begin_study(folder, "oracle", particles)
    (folder / "oracle.json").write_text(json.dumps({"cells": cells, "lost": lost}))


def sweep_of(folder: Path, task: str) -> Path:
    return write_sweep(folder, [PARTICLES], [f"task={task}", "a=1,2"])


@pytest.fixture
def benches(tmp_path: Path) -> Path:
    """Detection takes a millisecond a particle; the second has no further objects."""
    sweep = sweep_of(tmp_path / "sweep", "bench")
    for run, particles in enumerate((15, 150)):
        first = {"total": {"median_ms": float(particles), "cpu_ms": 2.0 * particles}}
        further = {"total": {"median_ms": particles / 4, "cpu_ms": particles / 2}}
        path = {"add_recall": 0.75, "first": first, "further": {} if run else further}
        result = {
            "machine": {"load": 1.25},
            "workload": {},
            "memory": {"peak_mib": 912.3},
            "paths": {"configured": path},
        }
        study = begin_study(sweep / str(run), "bench", particles)
        (study / "bench.json").write_text(json.dumps(result))
    begin_study(sweep / "10", "bench", 50, finished=False)
    return sweep


def test_every_study_has_a_row_with_what_differs(benches: Path) -> None:
    said = describe_sweep(only(benches), "text")
    header, _, *rows = (line.split() for line in said.split("\n\n")[0].splitlines())
    assert " ".join(header) == "particles ms first ms further MiB ADD(-S) load to first 95 % of it"
    assert rows == [
        ["15", "*", "15.0", "3.8", "912", "0.750", "1.2", "first"],
        ["150", "150", "912", "0.750", "1.2", "–"],
        ["50", "no", "result"],
    ]
    assert max(map(len, said.splitlines())) <= 80
    assert " ".join(said.split()).endswith(
        "bench by particles: 2 of 3 runs finished; best by ADD(-S): particles 15 (0.750), the"
        " first run; without a result: particles 50 (see 10/hlp.log)."
    )


def test_table_figure_and_page_of_studies_are_written_and_reported(benches: Path) -> None:
    written = write_files(benches, only(benches))
    assert [path.name for path in written] == ["bench.md", "bench.csv", "bench.png", "bench.svg"]
    assert "Made by `hlp -m task=bench a=1,2`." in written[0].read_text()
    rows = [[row[name] for name in ("particles", "MiB", "load")] for row in csv_rows(written[1])]
    assert rows == [["15 *", "912", "1.2"], ["150", "912", "1.2"], ["50", "", ""]]
    drawn = written[3].read_text()
    assert drawn.count("<!-- 0.750 -->") == 2  # the bars of the finished runs
    assert "<!-- 15 * -->" in drawn and "load" not in drawn
    report = report_runs(benches.parent, "text")
    assert describe_sweep(only(benches), "text") in report and "bench.csv" in report
    pages = [benches, benches / "0", benches / "1"]
    assert write_pages(benches) == [folder / "report.html" for folder in pages]
    text = write_sweep_page(benches).read_text()
    assert "2 of 3 runs finished" in text and "hlp -m task=bench a=1,2" in text
    assert '<a href="1/report.html">' in text and "10/report.html" not in text
    assert "image/svg+xml;base64," in text and "://" not in text


def test_recalls_of_an_oracle_matrix_have_intervals(tmp_path: Path) -> None:
    sweep = sweep_of(tmp_path / "sweep", "oracle")
    for run, particles in enumerate((25, 50)):
        write_oracle(sweep / str(run), particles)
    whole = sweep_table(only(sweep))
    assert [*whole.header[1:5], *whole.header[-5:-2]] == [
        "est/est", "95 %", "est/true", "95 %", "lost region", "lost coarse pose", "lost fine pose",
    ]  # fmt: skip
    assert [row[1:3] for row in whole.rows] == [["0.250", "0.100-0.900"], ["0.500", "0.100-0.900"]]
    assert [row[-4] for row in whole.rows] == ["-0.020", "-0.020"]
    said = describe_sweep(only(sweep), "text")
    assert said.count("0.100-0.900") == 2  # of the first cell alone
    assert max(map(len, said.splitlines())) <= 80


def write_targets(folder: Path, right: np.ndarray) -> None:
    """Verdicts on two objects in each of 40 frames, at most."""
    keys = [(1, frame, object_id, 0) for frame in range(40) for object_id in (1, 2)]
    verdicts = dict(zip(keys, map(float, right), strict=False))
    write_target_values(folder, {"ADD(-S)": verdicts}, {1: "a", 2: "b"})


def test_studies_are_paired_with_the_default_target_by_target(benches: Path) -> None:
    """The default is the second run; of the first one, half of the targets are known."""
    set_default(benches, "150.0")
    rng = np.random.default_rng(0)
    right, now = rng.random(80) < 0.6, rng.random(40) < 0.8
    write_targets(benches / "1", right)
    write_targets(benches / "0", now)
    sweep = only(benches)
    blocks = blocks_of([(1, i // 2) for i in range(40)])
    low, high = difference_interval(right[:40], now, blocks, 10_000, 0)
    gained = now.mean() - right[:40].mean()
    shown = sweep_table(sweep)
    assert shown.header[-2:] == ["to default", "95 % of it"]
    assert [row[0] for row in shown.rows[:2]] == ["15", "150"]  # the best one is not known
    assert shown.rows[1][-2:] == ["default", ""]
    assert shown.rows[0][-2:] == [f"{gained:+.3f}", f"{low:+.3f} to {high:+.3f}"]
    said = describe_sweep(sweep, "text")
    assert shown.rows[0][-1] in said and max(map(len, said.splitlines())) <= 80
    page = write_sweep_page(benches).read_text()
    assert shown.rows[0][-1] in page and "paired bootstrap" in page


@pytest.mark.parametrize("of_studies", [False, True])
def test_what_was_measured_on_other_frames_is_not_compared(
    of_studies: bool, benches: Path, tmp_path: Path
) -> None:
    folder = benches if of_studies else write_three_runs(tmp_path / "runs")
    for run in "01" if of_studies else "":
        write_targets(folder / run, np.arange(80) < 60)
    assert only(folder).best is not None and only(folder).differences
    change(folder / "0" / "manifest.json", data={"keys": ["000001"], "frames": "others"})
    sweep = only(folder)
    assert not sweep.differences and sweep.best is None
    assert "*" not in describe_sweep(sweep, "text")


def test_refiners_are_compared_by_their_mean_over_all_starts(tmp_path: Path) -> None:
    sweep = sweep_of(tmp_path / "sweep", "basin")
    rng, expected = np.random.default_rng(0), []
    for run in range(2):
        index = pd.MultiIndex.from_product(
            [["pso", "icp"], ["cat", "can"], [0.0, 10.0], [0.0, 5.0], range(4)],
            names=["refiner", "object", "rotation_deg", "translation_mm", "try"],
        )
        tried = pd.Series(rng.random(len(index)) < 0.5, index, name="right")
        write_basins(begin_study(sweep / str(run), "basin", run), basin_cells(tried.reset_index()))
        expected.append([tried["pso"].mean(), tried["icp"].mean()])
    found = [[n.value for n in run.numbers.values()] for run in only(sweep).finished]
    np.testing.assert_allclose(found, expected)


def test_the_best_trial_of_each_search(tmp_path: Path) -> None:
    sweep = sweep_of(tmp_path / "sweep", "search")
    for run, best in enumerate(({"recall": 0.9, "time_ms": 123.4}, None)):
        folder = begin_study(sweep / str(run), "search", run)
        (folder / "search.json").write_text(json.dumps({"trials": [1, 2], "best": best}))
    rows = [row[:4] for row in sweep_table(only(sweep)).rows]
    assert rows == [["0", "2", "0.900", "123"], ["1", "2", "", ""]]
    assert not only(sweep).differences and only(sweep).best is None
    assert len(write_files(sweep, only(sweep))) == 4
    change(sweep / "0" / "search.json", best=None)
    begin_study(sweep / "2", "search", 2, finished=False)
    assert sweep_table(only(sweep)).rows == [["0", "2"], ["1", "2"], ["2", "no result"]]


def test_each_kind_has_a_table_of_its_own(benches: Path) -> None:
    write_oracle(benches / "2", 75)
    write_scored(benches / "3", {PARTICLES: "5"}, 12, 30.0)
    labels = {sweep.name: [run.short_label for run in sweep.runs] for sweep in read_sweeps(benches)}
    assert labels == {"sweep": ["5", "50"], "bench": ["15", "150", "50"], "oracle": ["75", "50"]}


@pytest.mark.parametrize(
    ("study", "name", "content"),
    [
        ("bench", "bench.json", "{"),
        ("bench", "bench.json", "[]"),
        ("bench", "bench.json", '{"machine": 1, "workload": 1, "memory": 1, "paths": {}}'),
        ("oracle", "oracle.json", '{"cells": [{}], "lost": {}}'),
        ("oracle", "oracle.json", '{"cells": [], "lost": {"region": "much"}}'),
        ("basin", "basin.csv", "a,b\n1,2\n"),
        ("basin", "basin.csv", "refiner,object,rotation_deg,translation_mm,perturbations,right,"
         "add_recall\npso,all,0,0,1,1,many\n"),
        ("search", "search.json", '{"trials": 3}'),
    ],
)  # fmt: skip
def test_a_broken_study_is_named(study: str, name: str, content: str, tmp_path: Path) -> None:
    sweep = sweep_of(tmp_path / "sweep", study)
    (begin_study(sweep / "0", study, 1) / name).write_text(content)
    with pytest.raises(DataError, match=rf"0/{name}"):
        read_sweeps(sweep)
