"""What sweeps of runs end with: tables, figures, pages."""

import base64
import re
from pathlib import Path

import numpy as np
import pytest

from hlp.errors import DataError
from hlp.reporting.page import write_sweep_page
from hlp.reporting.report import write_pages
from hlp.reporting.results import result_folders
from hlp.reporting.sweep_report import describe_sweep, steps_of, sweep_figure, sweep_table
from hlp.reporting.sweep_report import write_sweep as write_files
from hlp.reporting.sweeps import read_sweeps
from table_text import csv_rows
from written_results import scored, summary, write_run, write_sweep
from written_sweeps import PARTICLES, change, only, set_default, write_scored, write_three_runs

BOP = {"ar": 0.654, "vsd": 0.6, "mssd": 0.7, "mspd": 0.662}


@pytest.fixture
def runs(tmp_path: Path) -> Path:
    return write_three_runs(tmp_path / "sweep")


def test_runs_are_compared_with_the_default_or_the_first_target_by_target(runs: Path) -> None:
    found = only(runs)
    assert found.is_default and found.reference is found.runs[1]
    difference = found.difference(found.runs[0], "ADD(-S)")
    assert difference is not None
    value, (low, high) = difference
    assert value == pytest.approx(-6 / 20)
    # Three of ten frames lose both of their targets: a binomial share of frames.
    drawn = -np.random.default_rng(1).binomial(10, 0.3, 100_000) / 10
    assert (low, high) == pytest.approx(tuple(np.percentile(drawn, [2.5, 97.5])), abs=0.051)
    assert found.difference(found.runs[1], "ADD(-S)") is None
    set_default(runs, "7")
    found = only(runs)
    assert not found.is_default and found.reference is found.runs[0]
    assert "+0.300 (+0.000 to +0.600) against the first run, not surely more" in found.verdict


def test_the_table_of_runs_has_all_numbers_and_fits_a_terminal(runs: Path) -> None:
    timing = summary()["timing"] | {"cpu_ms": 71.6, "wall_ms": 50.0, "load": 1.26}
    change(runs / "1" / "summary.json", timing=timing, bop=BOP)
    rows = csv_rows(write_files(runs, only(runs))[1])
    assert [[*row.values()] for row in rows] == [
        ["5", "20", "0.600", "0.500-0.640", "0.400", "0.650", "", "30", "60", "", "1.2", "-0.300",
         rows[0]["95 % of it"]],
        ["25 *", "20", "0.900", "0.800-0.940", "0.700", "0.950", "0.654", "50", "100", "72", "1.3",
         "default", ""],
        ["50", "", "no result", *[""] * 10],
    ]  # fmt: skip
    assert [*rows[0]] == [
        "particles", "targets", "ADD(-S)", "95 %", "5cm5deg", "IoU.5", "AR", "ms", "ms 95 %",
        "CPU ms", "load", "to default", "95 % of it",
    ]  # fmt: skip
    text = describe_sweep(only(runs), "text")
    assert max(map(len, text.splitlines())) <= 80
    assert sweep_table(only(runs), whole=False).header == [
        "particles", "ADD(-S)", "95 %", "5cm5deg", "ms", "load", "to default", "95 % of it",
    ]  # fmt: skip
    assert " ".join(text.split()).endswith(
        "sweep by particles: 2 of 3 runs finished; best by ADD(-S): particles 25 (0.900), the"
        " default; a tie with it: particles 5 (0.600); without a result: particles 50"
        " (see 2/hlp.log)."
    )


@pytest.mark.parametrize(
    ("right", "of_default", "tie"), [(18, 18, True), (20, 18, True), (18, 4, False)]
)
def test_the_default_wins_a_tie(tmp_path: Path, right: int, of_default: int, tie: bool) -> None:
    """A faster run that is right for as many targets, or for few more, is no better one."""
    folder = write_sweep(tmp_path / "sweep", [PARTICLES], [f"{PARTICLES}=5,25"])
    set_default(folder, "25")
    write_scored(folder / "0", {PARTICLES: "5"}, right, 30.0)
    write_scored(folder / "1", {PARTICLES: "25"}, of_default, 50.0)
    found = only(folder)
    assert found.best is found.runs[int(tie)]
    said = f"particles 25 (0.900), the default; a tie with it: particles 5 ({right / 20:.3f})"
    assert ("a tie with it" in found.verdict) == tie == (f"by ADD(-S): {said}." in found.verdict)


def test_ties_of_the_best_run_are_named_also_where_it_is_not_the_default(tmp_path: Path) -> None:
    folder = write_sweep(tmp_path / "sweep", [PARTICLES], [f"{PARTICLES}=1,2,3,4,5,6"])
    for number, right in enumerate((4, 17, 18, 18, 18, 17)):
        write_scored(folder / str(number), {PARTICLES: str(number + 1)}, right, 50.0 - number)
    set_default(folder, "1")
    found = only(folder)
    assert found.best is found.runs[2]
    assert found.winner.startswith("particles 3 (0.900), +0.700 (+")
    assert found.winner.endswith(
        "surely more; a tie with it: particles 4 (0.900), particles 5 (0.900), particles 2 (0.850),"
        " particles 6 (0.850)"
    )


@pytest.mark.parametrize(
    ("swept", "panels"), [([PARTICLES], 4), ([PARTICLES, "seed"], 3), ([PARTICLES, "seed", "x"], 4)]
)
def test_every_sweep_is_drawn(tmp_path: Path, swept: list[str], panels: int) -> None:
    folder = write_sweep(tmp_path / "sweep", swept, [])
    for number, value in enumerate(("5", "25")):
        chosen = {key: value if key == PARTICLES else "1" for key in swept}
        write_scored(folder / str(number), chosen, 10 + number, 30.0)
    timing = summary()["timing"] | {"load": 9.0}
    change(folder / "1" / "summary.json", timing=timing)
    change(folder / "sweep.json", defaults=dict.fromkeys(swept, "1") | {PARTICLES: "25"})
    figure = sweep_figure(only(folder))
    assert figure is not None and len(figure.axes) == panels
    if panels == 3:
        recalls, times, loads = (ax.images[0].get_array() for ax in figure.axes)
        np.testing.assert_allclose(recalls, [[0.5, 0.55]])
        np.testing.assert_allclose(times, [[30.0, 30.0]])
        np.testing.assert_allclose(loads, [[1.25, 9.0]])
        marked = [text for text in figure.axes[0].texts if "(default)" in text.get_text()]
        assert [text.get_position() for text in marked] == [(1, 0)]
        assert figure.axes[0].get_xlabel() == PARTICLES


def test_a_sweep_without_any_result_still_has_its_table(runs: Path) -> None:
    for run in "01":
        (runs / run / "manifest.json").unlink()
    found = only(runs)
    assert [path.name for path in write_files(runs, found)] == ["sweep.md", "sweep.csv"]
    assert "0 of 3 runs finished" in describe_sweep(found, "text")
    assert sweep_table(found).rows[0] == ["5", "no result"]
    assert read_sweeps(write_sweep(runs.parent / "empty", ["a"], [])) == []


def test_the_page_of_runs_shows_figures_and_leads_to_theirs(runs: Path) -> None:
    names = [f"{name}.{e}" for name in ("sweep", "recall_by_time") for e in ("png", "svg")]
    written = [path.name for path in write_files(runs, only(runs))]
    assert written == ["sweep.md", "sweep.csv", *names]
    pages = write_pages(runs)
    assert [page.parent for page in pages] == [runs / "0", runs / "1", runs]
    text = pages[-1].read_text()
    assert 'href="0/report.html"' in text and 'href="2/report.html"' not in text
    assert "best by ADD(-S): particles 25" in text and "://" not in text
    drawn = re.findall(r'src="data:image/svg\+xml;base64,([^"]+)"', text)
    files = [(runs / f"{name}.svg").read_bytes() for name in ("sweep", "recall_by_time")]
    assert list(map(base64.b64decode, drawn)) == files
    with pytest.raises(DataError, match="holds no finished run"):
        write_sweep_page(write_sweep(runs.parent / "empty", ["a"], []))


@pytest.mark.parametrize(
    ("key", "values", "steps"),
    [
        (PARTICLES, ["5", "25"], [5, 25]),
        (PARTICLES, ["5", "5"], [0, 1]),
        ("x", ["0.5", ""], [0, 1]),
        ("", ["1"], [0]),
    ],
)
def test_steps_are_the_values_of_one_key_of_whole_numbers(
    key: str, values: list[str], steps: list[int]
) -> None:
    assert steps_of([key] if key else [], [{key: value} for value in values]) == steps


SUMMARY = scored(0.8, 100.0, {"cat": 0.8})


def sweep_of_eleven(folder: Path) -> Path:
    write_sweep(folder, ["refinement.particles"], ["experiment=fig9b", "seed=1"])
    for i in range(11):
        given = [f"refinement.particles={i + 1}", f"output={folder}"]
        write_run(folder / str(i), "fig9b", SUMMARY, given, refinement={"particles": i + 1})
    return folder


def test_runs_are_read_in_their_order_and_with_what_was_chosen(tmp_path: Path) -> None:
    (found,) = read_sweeps(sweep_of_eleven(tmp_path / "sweep"))
    particles = [run.config["refinement"]["particles"] for run in found.results]
    assert particles == list(range(1, 12))
    assert found.results[10].chosen == {"refinement.particles": "11"}
    assert (found.command, found.unfinished) == ("hlp -m experiment=fig9b seed=1", [])
    assert (found.results[0].experiment, found.results[0].frames) == ("fig9b", 2)


def test_sweeps_and_single_runs_are_found_but_not_runs_of_sweeps(tmp_path: Path) -> None:
    sweep = sweep_of_eleven(tmp_path / "a" / "sweep")
    run = write_run(tmp_path / "b", "table1", SUMMARY, ["experiment=table1", "output=b"])
    assert result_folders(tmp_path) == [sweep, run]
    assert result_folders(run) == [run]
    assert [found.command for found in read_sweeps(run)] == ["hlp run experiment=table1"]


def test_a_broken_run_is_named(tmp_path: Path) -> None:
    run = write_run(tmp_path / "broken", "table1", SUMMARY)
    (run / "summary.json").write_text("{")
    with pytest.raises(ValueError, match=r"broken/summary\.json is not JSON"):
        read_sweeps(run)


def test_what_measures_stages_has_no_summary_and_is_passed_over(tmp_path: Path) -> None:
    run = write_run(tmp_path / "sweep" / "0", "oracle", SUMMARY)
    (run / "summary.json").unlink()
    assert result_folders(tmp_path) == []
    folder = write_sweep(tmp_path / "other", [], [])
    run.rename(folder / "0")
    assert read_sweeps(folder) == []
