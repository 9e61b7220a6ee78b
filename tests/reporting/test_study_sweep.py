"""What sweeps of studies end with: tables, figures, pages."""

import csv
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hlp.errors import DataError
from hlp.reporting.figures.basin_maps import Basins, write_basins
from hlp.reporting.page.study_page import write_study_sweep_page
from hlp.reporting.report import report_runs, write_pages
from hlp.reporting.study_arms import StudySweep, read_study_sweeps
from hlp.reporting.study_sweep import (
    describe_study_sweep,
    differences_table,
    study_table,
    write_study_sweep,
)
from hlp.results.intervals import blocks_of, difference_interval
from hlp.results.summary_file import write_target_values
from written_results import scored, write_run, write_sweep


def begin_arm(folder: Path, task: str, particles: int, finished: bool = True) -> Path:
    (folder / ".hydra").mkdir(parents=True)
    given = [f"task={task}", f"refinement.particles={particles}"]
    (folder / ".hydra" / "overrides.yaml").write_text(json.dumps(given))
    if finished:
        manifest = {
            "config": {"task": {"name": task}, "data": {"name": "synthetic"}},
            "data": {"keys": ["000001"], "frames": "abc"},
        }
        (folder / "manifest.json").write_text(json.dumps(manifest))
        (folder / f"{task}.md").write_text("A table.\n")
    return folder


def write_bench(folder: Path, particles: int, further: bool = True) -> None:
    """An arm of which detection takes a millisecond a particle."""
    path: dict[str, Any] = {
        "add_recall": 0.75,
        "first": {"total": {"median_ms": float(particles), "cpu_ms": 2.0 * particles}},
        "further": {"total": {"median_ms": particles / 4, "cpu_ms": particles / 2}},
    }
    result = {
        "machine": {"load": 1.25},
        "workload": {},
        "memory": {"peak_mib": 912.3},
        "paths": {"configured": path if further else {**path, "further": {}}},
    }
    begin_arm(folder, "bench", particles)
    (folder / "bench.json").write_text(json.dumps(result))


def write_oracle(folder: Path, particles: int) -> None:
    recall = particles / 100
    cells = [
        {"region": region, "coarse": coarse, "add": {"recall": recall, "ci95": [0.1, 0.9]}}
        for region in ("estimated", "true")
        for coarse in ("estimated", "true", "noisy")
    ]
    lost = {"region": 0.01, "coarse pose": -0.02, "fine pose": 0.1}
    begin_arm(folder, "oracle", particles)
    (folder / "oracle.json").write_text(json.dumps({"cells": cells, "lost": lost}))


def sweep_of(folder: Path, task: str) -> Path:
    return write_sweep(folder, ["refinement.particles"], [f"task={task}", "a=1,2"])


@pytest.fixture
def benches(tmp_path: Path) -> Path:
    sweep = sweep_of(tmp_path / "sweep", "bench")
    for arm, particles in enumerate((15, 150)):
        write_bench(sweep / str(arm), particles, further=arm == 0)
    begin_arm(sweep / "10", "bench", 50, finished=False)
    return sweep


def only_study(folder: Path) -> StudySweep:
    (found,) = read_study_sweeps(folder)
    return found


def rows_of(path: Path) -> list[dict[str, str]]:
    with path.open(newline="") as stream:
        return list(csv.DictReader(stream))


def test_every_arm_has_a_row_with_what_differs(benches: Path) -> None:
    said = describe_study_sweep(only_study(benches), "text")
    header, _, *rows = (line.split() for line in said.split("\n\n")[0].splitlines())
    assert (
        " ".join(header) == "particles ms first ms further CPU first CPU further MiB ADD(-S) load"
    )
    assert rows == [
        ["15", "*", "15.0", "3.8", "30.0", "7.5", "912", "0.750", "1.2"],
        ["150", "150", "300", "912", "0.750", "1.2"],
        ["50", "no", "result"],
    ]
    assert max(map(len, said.splitlines())) <= 80
    ending = (
        "bench by particles: 2 of 3 arms finished; lowest ms first: 15 (15.0); that is the first"
        " arm; without a result: 50 (see 10/hlp.log)."
    )
    assert " ".join(said.split()).endswith(ending)


def test_table_and_figure_are_written_and_reported(benches: Path) -> None:
    written = write_study_sweep(benches, only_study(benches))
    assert [path.name for path in written] == ["bench.md", "bench.csv", "bench.png", "bench.svg"]
    assert "Made by `hlp -m task=bench a=1,2`." in written[0].read_text()
    rows = rows_of(written[1])
    assert [row["MiB"] for row in rows] == ["912.3", "912.3", ""]
    assert [row["load"] for row in rows] == ["1.25", "1.25", ""]
    assert [row["refinement.particles"] for row in rows] == ["15", "150", "50"]
    drawn = written[3].read_text()
    assert drawn.count("<!-- 0.750 -->") == 2  # the bars of the finished arms
    assert "<!-- axis cut: begins at 0.7 -->" in drawn
    assert "<!-- 15 * -->" in drawn and "load" not in drawn
    report = report_runs(benches.parent, "text")
    assert describe_study_sweep(only_study(benches), "text") in report and "bench.csv" in report


def test_recalls_of_an_oracle_matrix_have_intervals(tmp_path: Path) -> None:
    sweep = sweep_of(tmp_path / "sweep", "oracle")
    for arm, particles in enumerate((25, 50)):
        write_oracle(sweep / str(arm), particles)
    whole = study_table(only_study(sweep))
    assert [*whole.header[1:3], *whole.header[-3:]] == [
        "est/est", "est/true", "lost region", "lost coarse pose", "lost fine pose",
    ]  # fmt: skip
    assert [row[1] for row in whole.rows] == ["0.250 (0.100-0.900)", "0.500 (0.100-0.900)"]
    assert [row[-2] for row in whole.rows] == ["-0.020", "-0.020"]
    said = describe_study_sweep(only_study(sweep), "text")
    assert "0.250 " in said and "0.900" not in said
    assert max(map(len, said.splitlines())) <= 80
    _, rows, *_ = write_study_sweep(sweep, only_study(sweep))
    ends = [(row["true/est"], row["true/est 95 % low"]) for row in rows_of(rows)]
    assert ends == [("0.25", "0.1"), ("0.5", "0.1")]
    assert "lost region 95 % low" not in rows_of(rows)[0]


def write_targets(folder: Path, **values: np.ndarray) -> None:
    """Values of two objects in each of 40 frames, at most."""
    keys = [(1, frame, object_id, 0) for frame in range(40) for object_id in (1, 2)]
    named = {
        name.replace("_", " "): dict(zip(keys, map(float, each), strict=False))
        for name, each in values.items()
    }
    write_target_values(folder, named, {1: "a", 2: "b"})


def test_arms_are_paired_with_the_default_target_by_target(benches: Path) -> None:
    """The default is the second arm; of the first one, half of the targets are known."""
    record = json.loads((benches / "sweep.json").read_text())
    record["defaults"] = {"refinement.particles": "150.0"}
    (benches / "sweep.json").write_text(json.dumps(record))
    rng = np.random.default_rng(0)
    before, after = rng.gamma(4.0, 40.0, 80), rng.gamma(4.0, 30.0, 40)
    right, now = rng.random(80) < 0.6, rng.random(40) < 0.8
    write_targets(benches / "1", ms_first=before, **{"ADD(-S)": right})
    write_targets(benches / "0", ms_first=after, **{"ADD(-S)": now})
    sweep = only_study(benches)
    low, high = difference_interval(right[:40], now, blocks_of([(1, i // 2) for i in range(40)]),
                                    10_000, 0)  # fmt: skip
    gained = now.mean() - right[:40].mean()
    shown = differences_table(sweep)
    assert shown is not None
    assert shown.header == ["particles", "ms first to default", "ADD(-S) to default"]
    assert [row[0] for row in shown.rows] == ["15", "150"]  # the best one is not known
    assert shown.rows[1][1:] == ["default", "default"]
    assert shown.rows[0][2] == f"{gained:+.3f} ({low:+.3f} to {high:+.3f})"
    faster = np.median(after) - np.median(before[:40])
    assert shown.rows[0][1].startswith(f"{faster:+.1f} (-")
    said = describe_study_sweep(sweep, "text")
    assert shown.rows[0][1] in said and max(map(len, said.splitlines())) <= 80
    _, rows, *_ = write_study_sweep(benches, sweep)
    first, second, _ = rows_of(rows)
    assert float(first["ADD(-S) difference"]) == pytest.approx(gained)
    assert float(first["ADD(-S) difference 95 % low"]) == pytest.approx(low)
    assert second["ADD(-S) difference"] == "" and "CPU first difference" not in first
    page = write_study_sweep_page(benches).read_text()
    assert shown.rows[0][2] in page and "paired bootstrap" in page


def test_the_best_arm_is_said_with_its_difference(benches: Path) -> None:
    record = json.loads((benches / "sweep.json").read_text())
    record["defaults"] = {"refinement.particles": "150"}
    (benches / "sweep.json").write_text(json.dumps(record))
    slow = 150.0 + np.random.default_rng(0).normal(size=80)
    for arm, times in ((0, slow - 135.0), (1, slow)):
        write_targets(benches / str(arm), ms_first=times)
    sweep = only_study(benches)
    assert (
        "lowest ms first: 15 (15.0); -135.0 (-135.0 to -135.0) against the default, surely less;"
        in sweep.verdict
    )
    page = write_study_sweep_page(benches).read_text()
    assert '<tr class="best"><td>15 *</td>' in page


def test_arms_of_other_frames_are_not_paired(benches: Path) -> None:
    for arm in (0, 1):
        write_targets(benches / str(arm), ms_first=np.full(80, 20.0))
    manifest = json.loads((benches / "1" / "manifest.json").read_text())
    manifest["data"]["frames"] = "other"
    (benches / "1" / "manifest.json").write_text(json.dumps(manifest))
    sweep = only_study(benches)
    assert differences_table(sweep) is None and sweep.best is None
    assert "*" not in describe_study_sweep(sweep, "markdown")


def test_refiners_are_compared_by_their_mean_over_all_starts(tmp_path: Path) -> None:
    sweep = sweep_of(tmp_path / "sweep", "basin")
    right = np.random.default_rng(0).random((2, 5, 3, 2)) < 0.5
    right[0, 0] = True
    for arm, verdicts in enumerate(right):
        refiners = {"pso": {"cat": verdicts, "can": verdicts[:2]}}
        folder = begin_arm(sweep / str(arm), "basin", arm)
        write_basins(folder, Basins((0.0, 10.0, 20.0), (0.0, 5.0), refiners))
    expected = [np.concatenate([each, each[:2]]).mean() for each in right]
    found = [numbers[0].value for _, numbers in only_study(sweep).finished]
    np.testing.assert_allclose(found, expected)


def test_the_best_trial_of_each_search(tmp_path: Path) -> None:
    sweep = sweep_of(tmp_path / "sweep", "search")
    for arm, best in enumerate(({"recall": 0.9, "time_ms": 123.4}, None)):
        folder = begin_arm(sweep / str(arm), "search", arm)
        (folder / "search.json").write_text(json.dumps({"trials": [1, 2], "best": best}))
    assert study_table(only_study(sweep)).rows == [["0", "2", "0.900", "123"], ["1", "2", "", ""]]
    assert differences_table(only_study(sweep)) is None and only_study(sweep).best is None
    assert len(write_study_sweep(sweep, only_study(sweep))) == 4


def test_the_page_shows_all_arms_and_leads_to_theirs(benches: Path) -> None:
    with pytest.raises(DataError, match="holds no finished study"):
        write_study_sweep_page(write_sweep(benches.parent / "empty", ["a"], []))
    written = write_pages(benches)
    assert written == [benches / "report.html", *(benches / f"{i}" / "report.html" for i in (0, 1))]
    write_study_sweep(benches, only_study(benches))
    text = write_study_sweep_page(benches).read_text()
    assert "2 of 3 arms finished" in text and "hlp -m task=bench a=1,2" in text
    assert '<a href="1/report.html">' in text and "10/report.html" not in text
    assert "image/svg+xml;base64," in text and "http" not in text


def test_studies_of_several_kinds_have_a_table_each(benches: Path) -> None:
    write_oracle(benches / "2", 75)
    bench, oracle = read_study_sweeps(benches)
    assert [arm.label for arm in bench.arms] == ["15", "150", "50"]
    assert [arm.label for arm in oracle.arms] == ["75", "50"]
    written = report_runs(benches, "markdown")
    assert "oracle by particles: 1 of 2 arms finished" in written
    assert "bench by particles: 2 of 3 arms finished" in written


def test_other_sweeps_have_none(tmp_path: Path) -> None:
    sweep = write_sweep(tmp_path / "sweep", ["seed"], ["seed=1"])
    write_run(sweep / "0", "demo", scored(0.5, 40.0, {"cat": 0.5}))
    begin_arm(sweep / "1", "bench", 3, finished=False)
    assert read_study_sweeps(sweep) == []


@pytest.mark.parametrize(
    ("study", "name", "content"),
    [
        ("bench", "bench.json", "{"),
        ("bench", "bench.json", "[]"),
        ("bench", "bench.json", '{"machine": 1, "workload": 1, "memory": 1, "paths": {}}'),
        ("oracle", "oracle.json", '{"cells": [{}], "lost": {}}'),
        ("oracle", "oracle.json", '{"cells": [], "lost": {"region": "much"}}'),
        ("basin", "basin.csv", "a,b\n1,2\n"),
        ("search", "search.json", '{"trials": 3}'),
    ],
)
def test_a_broken_study_is_named(study: str, name: str, content: str, tmp_path: Path) -> None:
    sweep = sweep_of(tmp_path / "sweep", study)
    (begin_arm(sweep / "0", study, 1) / name).write_text(content)
    with pytest.raises(DataError, match=rf"0/{name}"):
        read_study_sweeps(sweep)
