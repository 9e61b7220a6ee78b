"""Reports of single experiments: the paper's figures and tables, ladder."""

import json
from pathlib import Path

import cv2
import numpy as np
import pytest
from hydra import compose, initialize_config_dir

from composed_settings import run_settings
from hlp.commands.composing import config_folder
from hlp.reporting.experiments import describe_reports, reports_of, write_reports
from hlp.reporting.paper_reports import TABLES, TRENDS, object_recalls_table, trend_tables
from hlp.reporting.results import Result
from hlp.results.recalls import difference_interval
from table_text import csv_rows, unpadded
from written_results import CONFIG, scored, write_run, write_sweep, write_verdicts

OBJECTS = {"cat": 0.9, "ape": 0.8}
ENDINGS = ("png", "svg", "md", "csv", "tex")


def boxes(folder: Path) -> Path:
    """Fig. 9c of two methods: two boxes each."""
    overrides = ["experiment=fig9c", "method=paper,hlp"]
    write_sweep(folder, ["method", "refinement.theta_deg"], overrides)
    runs = [(method, theta) for method in ("paper", "hlp") for theta in (2, 5)]
    for i, (method, theta) in enumerate(runs):
        given = [f"refinement.theta_deg={theta}", f"method={method}", "experiment=fig9c"]
        box = {"theta_deg": float(theta), "tau_mm": float(theta)}
        summary = scored(0.5 + 0.1 * i, 100.0, OBJECTS)
        write_verdicts(
            write_run(folder / str(i), "fig9c", summary, given, refinement=box), [1, 1, i % 2, 0]
        )
    return folder


def test_a_sweep_gets_figure_and_table_in_every_format_and_the_same_again(tmp_path: Path) -> None:
    folder = boxes(tmp_path / "sweep")
    png, svg, markdown, table, latex, figures = files = write_reports(folder)
    assert {path.name for path in files[:-1]} == {f"fig9c.{ending}" for ending in ENDINGS}
    assert cv2.imread(str(png)).shape[1] > 600 and svg.stat().st_size
    rows = csv_rows(table)
    assert [row["box of the search {θ, τ}"] for row in rows] == ["{2°, 2 mm}", "{5°, 5 mm}"] * 2
    assert [row[""] for row in rows] == ["method paper"] * 2 + ["method hlp"] * 2
    text = markdown.read_text()
    assert "Made by `hlp -m experiment=fig9c method=paper,hlp`." in text
    assert "compare the trends, not numbers" in text
    assert "40 targets in 2 frames of lm (bop)" in text
    assert r"\{5$^\circ$, 5 mm\} & method hlp & 40 & 0.800" in unpadded(latex.read_text())
    keys = "refinement.theta_deg, refinement.tau_mm, method"
    assert figures.read_text().splitlines()[:3] == [
        "figure,setting,value,add,add_low,add_high,5cm5deg,ar,difference,difference_low,"
        "difference_high",
        f'9c,"{keys} paper","{{2°, 2 mm}}",0.500,0.400,0.540,0.300,,-0.250,-0.500,+0.000',
        f'9c,"{keys} paper","{{5°, 5 mm}}",0.600,0.500,0.640,0.400,,,,',
    ]
    before = [path.read_bytes() for path in files]
    assert [path.read_bytes() for path in write_reports(folder)] == before
    (folder / "2" / "manifest.json").unlink()
    said = describe_reports(tmp_path, "markdown")
    assert "left out: 1." in said and said.count("{2°, 2 mm}") == 1


@pytest.mark.parametrize("name", TABLES)
def test_a_single_run_is_a_table(tmp_path: Path, name: str) -> None:
    folder = write_run(tmp_path / "run", name, scored(0.7, 100.0, OBJECTS), [f"experiment={name}"])
    said = unpadded(describe_reports(tmp_path, "markdown"))
    assert f"Made by `hlp run experiment={name}`." in said
    cells = {
        "table1": ["cat", "20", "0.979", "0.900", "0.700-0.950"],
        "table2": ["ADD(-S)", "0.632", "0.566", "0.700", "0.600-0.740"],
    }[name]
    assert f"| {' | '.join(cells)} |" in said
    assert all((folder / f"{name}.{ending}").stat().st_size for ending in ENDINGS)
    lines = describe_reports(tmp_path, "text").splitlines()
    assert TABLES[name] in lines[0] and cells in [line.split() for line in lines]


def test_other_experiments_have_no_report(tmp_path: Path) -> None:
    folder = write_run(tmp_path / "run", "demo", scored(0.7, 100.0, OBJECTS))
    assert describe_reports(tmp_path, "text") == "" and write_reports(folder) == []
    assert not list(folder.glob("demo.*"))


@pytest.mark.parametrize("name", [*TRENDS, *TABLES])
def test_the_experiment_is_named_as_its_file_and_sweeps_what_it_shows(name: str) -> None:
    overrides = [f"experiment={name}", "output=out"]
    with initialize_config_dir(str(config_folder()), version_base="1.3"):
        config = compose("config", overrides=overrides, return_hydra_config=True)
    params = dict(config.hydra.sweeper.params or {})
    assert config.name == name
    assert set(params) <= set(TRENDS[name].keys if name in TRENDS else ())
    assert name in TABLES or str(params.values()).count(",") >= 2


def test_one_key_moves_both_sides_of_the_box() -> None:
    """Another pair is a matter of the other key beside it."""
    for given, box in (([], (2, 2)), (["method=paper"], (2, 2)), (["refinement.tau_mm=7"], (2, 7))):
        overrides = ["experiment=fig9c", "refinement.theta_deg=2", *given]
        settings = run_settings(*overrides).refinement
        assert (settings.theta_deg, settings.tau_mm) == box


def trained(length: int, add: float = 0.5, ms: float = 9.0) -> Result:
    """A run with features of that length, and for the rest what the paper chose."""
    config = {"name": "x", **CONFIG, "encoder": {"dimension": length}}
    return Result(config, scored(add, ms, {"cat": add}), 2, {"refinement": "pso"})


def test_papers_numbers_stand_beside_its_own_setting_alone() -> None:
    runs = [trained(100, 0.7, 300.0), trained(200, 0.8, 350.0), trained(400, 0.75, 500.0)]
    table, _ = trend_tables(TRENDS["fig9a"], [("", run) for run in runs])
    own = ["200", "20", "0.800", "0.700-0.840", "350", "1.2", "0.600", "0.850", "700", "88"]
    assert list(table.rows[1]) == [*own, "0.960", "800"]
    assert [list(row[-2:]) for row in table.rows[::2]] == [["", ""]] * 2
    assert table.header[0] == "length of the local feature" and table.header[-2] == "paper ADD(-S)"
    values = {name: trend.value(runs[1]) for name, trend in TRENDS.items()}
    assert values == {"fig9a": "200", "fig9b": "25", "fig9c": "{5°, 5 mm}", "pso_vs_icp": "pso"}
    assert all(trend.is_papers(runs[1]) for trend in TRENDS.values())


def run(add: float, objects: dict[str, float]) -> Result:
    return Result({}, scored(add, 100.0, objects), 2, {})


def test_table_1_has_the_paper_first_and_its_mean_over_the_same_objects() -> None:
    table = object_recalls_table({"ours": run(0.85, OBJECTS)})
    assert list(table.header) == ["object", "targets", "paper", "ours", "95 %"]
    assert [list(row) for row in table.rows] == [
        ["cat", "20", "0.979", "0.900", "0.700-0.950"],
        ["ape", "20", "0.970", "0.800", "0.600-0.850"],
        ["mean of objects", "", "0.974", "0.850", ""],
        ["standard deviation", "", "0.005", "0.050", ""],
        ["all targets", "40", "", "0.850", "0.750-0.890"],
    ]
    others = object_recalls_table({"ours": run(0.85, {"duck": 0.9, "wedge": 0.8})})
    assert list(others.header) == ["object", "targets", "ours", "95 %"]  # another set's duck


def test_table_1_of_two_runs_leaves_blank_what_one_was_not_asked_for() -> None:
    runs = {"method paper": run(0.5, {"cat": 0.5}), "method hlp": run(0.85, OBJECTS)}
    table = object_recalls_table(runs)
    assert list(table.header[3:]) == ["method paper", "95 %", "method hlp", "95 %"]
    assert list(table.rows[1]) == ["ape", "", "0.970", "", "", "0.800", "0.600-0.850"]
    assert list(table.rows[2][3:]) == ["0.500", "", "0.850", ""]


RIGHT = {"literal": [0, 0, 0, 1], "modes": [1, 0, 1, 1], "best": [1, 1, 1, 0]}
BEFORE = {"literal": None, "modes": "literal", "best": "modes"}


def ladder(folder: Path, names: tuple[str, ...] = ("literal", "modes", "best")) -> Path:
    """Steps that find four targets, two each in two frames, as `RIGHT` says."""
    write_sweep(folder, ["ladder"], ["experiment=ladder"])
    for number, name in enumerate(names):
        summary = scored(float(np.mean(RIGHT[name])), 100.0 - 20.0 * number, {"ape": 0.5})
        summary["bop"]["ar"] = 0.5 + 0.125 * number
        run = write_run(folder / str(number), "ladder", summary, [f"ladder={name}"])
        manifest = json.loads((run / "manifest.json").read_text())
        manifest["config"]["step"] = {"change": f"what {name} is", "before": BEFORE[name]}
        (run / "manifest.json").write_text(json.dumps(manifest))
        write_verdicts(run, RIGHT[name], 0.5)
    return folder


def test_a_row_a_step_with_what_it_gains_against_the_one_before_it(tmp_path: Path) -> None:
    png, svg, markdown, table, _, figures = files = write_reports(ladder(tmp_path / "sweep"))
    assert {path.name for path in files[:-1]} == {f"ladder.{ending}" for ending in ENDINGS}
    assert png.stat().st_size and svg.stat().st_size
    rows = csv_rows(table)
    assert [*rows[0]] == [
        "step", "change", "ADD(-S)", "95 %", "5cm5deg", "IoU.5", "AR", "ms", "load", "against",
        "gained", "95 % of it", "ms more",
    ]  # fmt: skip
    said = [(r["step"], r["ADD(-S)"], r["against"], r["gained"], r["ms more"]) for r in rows]
    assert said == [
        ("literal", "0.250", "–", "–", "–"),
        ("modes", "0.750", "literal", "+0.500", "-20"),
        ("best", "0.750", "modes", "+0.000", "-20"),
    ]
    assert [row["AR"] for row in rows] == ["0.500", "0.625", "0.750"]
    # Both frames of `modes` gain one target of two: resamples are alike, Wilson's intervals stand.
    assert rows[1]["95 % of it"] == "-0.102 to +0.850"
    # Frame 0 gains one of two targets, frame 1 loses one: an interval of the paired bootstrap.
    before, after = (np.array(RIGHT[name], dtype=bool) for name in ("modes", "best"))
    assert difference_interval(before, after, np.array([0, 0, 1, 1]), 10_000, 0) == (-0.5, 0.5)
    assert rows[2]["95 % of it"] == "-0.500 to +0.500"
    assert figures.read_text().splitlines() == [
        "step,change,add,add_low,add_high,5cm5deg,iou50,ar,visible_below_0.6,from,gain,gain_low,"
        "gain_high",
        "literal,what literal is,0.250,0.150,0.290,0.050,0.300,0.500,1.000,,,,",
        "modes,what modes is,0.750,0.650,0.790,0.550,0.800,0.625,1.000,"
        "literal,+0.500,-0.102,+0.850",
        "best,what best is,0.750,0.650,0.790,0.550,0.800,0.750,0.000,modes,+0.000,-0.500,+0.500",
    ]
    text = markdown.read_text()
    assert "Made by `hlp -m experiment=ladder`." in text and "what modes is" in text
    shown = unpadded(describe_reports(tmp_path, "markdown"))
    assert "| literal | what literal is | 0.250 |" in shown
    lines = describe_reports(tmp_path, "text").split("\n")
    (row,) = [line for line in lines if "modes " in line[:6]]
    assert unpadded(row) == "modes 0.750 80 literal +0.500 -0.102 to +0.850 -20"


def test_a_step_whose_predecessor_was_not_run_stands_alone(tmp_path: Path) -> None:
    *_, table, _, figures = write_reports(ladder(tmp_path / "sweep", ("literal", "best")))
    assert [row["against"] for row in csv_rows(table)] == ["–", "–"]
    assert [row["gain"] for row in csv_rows(figures)] == ["", ""]


def test_a_line_leads_to_each_recall_from_the_step_that_it_starts_from(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(BEFORE, "best", "literal")  # a branch, beside that of `modes`
    (report,) = reports_of(ladder(tmp_path / "sweep"))
    assert report.figure is not None
    lines = [line for line in report.figure.axes[0].lines if line.get_color() == "0.6"]
    ends = [(*np.ravel(line.get_xdata()), *np.ravel(line.get_ydata())) for line in lines]
    assert ends == [(0.25, 0.75, 0, 1), (0.25, 0.75, 0, 2)]
