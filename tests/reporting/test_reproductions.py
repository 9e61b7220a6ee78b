import csv
from pathlib import Path

import cv2
import pytest
from hydra import compose, initialize_config_dir
from omegaconf import OmegaConf

from hlp.commands.composing import config_folder
from hlp.config.build import build_settings
from hlp.reporting.figures.trends import TRENDS
from hlp.reporting.reproductions import (
    TABLES,
    describe_reproductions,
    describe_table,
    write_reproductions,
)
from hlp.reporting.tables.table import TERMINAL
from table_text import unpadded
from written_results import scored, write_run, write_sweep

OBJECTS = {"cat": 0.9, "ape": 0.8}
ENDINGS = ("png", "svg", "md", "csv", "tex")


def boxes(folder: Path) -> Path:
    """Fig. 9c of two methods: two boxes each."""
    overrides = ["experiment=fig9c", "method=paper,hlp"]
    write_sweep(folder, ["method", "refinement.theta_deg"], overrides)
    arms = [(method, theta) for method in ("paper", "hlp") for theta in (2, 5)]
    for i, (method, theta) in enumerate(arms):
        given = [f"refinement.theta_deg={theta}", f"method={method}", "experiment=fig9c"]
        box = {"theta_deg": float(theta), "tau_mm": float(theta)}
        write_run(
            folder / str(i), "fig9c", scored(0.5 + 0.1 * i, 100.0, OBJECTS), given, refinement=box
        )
    return folder


def test_a_sweep_gets_figure_and_table_in_every_format(tmp_path: Path) -> None:
    folder = boxes(tmp_path / "sweep")
    files = write_reproductions(folder)
    assert [path.name for path in files] == [f"fig9c.{ending}" for ending in ENDINGS]
    assert cv2.imread(str(files[0])).shape[1] > 600
    with files[3].open(newline="") as stream:
        rows = list(csv.DictReader(stream))
    assert [row["box of the search {θ, τ}"] for row in rows] == ["{2°, 2 mm}", "{5°, 5 mm}"] * 2
    assert [row[""] for row in rows] == ["method paper"] * 2 + ["method hlp"] * 2
    text = files[2].read_text()
    assert "Made by `hlp -m experiment=fig9c method=paper,hlp`." in text
    assert "compare the trends, not numbers" in text
    assert "40 targets in 2 frames of lm (bop)" in text
    assert r"\{5$^\circ$, 5 mm\} & method hlp & 40 & 0.800" in unpadded(files[4].read_text())


def test_the_same_results_give_the_same_files(tmp_path: Path) -> None:
    folder = boxes(tmp_path / "sweep")
    before = [path.read_bytes() for path in write_reproductions(folder)]
    assert [path.read_bytes() for path in write_reproductions(folder)] == before


def test_unfinished_arms_are_counted(tmp_path: Path) -> None:
    folder = boxes(tmp_path / "sweep")
    (folder / "2" / "manifest.json").unlink()
    told = describe_reproductions(tmp_path, "markdown")
    assert "left out: 1." in told
    assert told.count("{2°, 2 mm}") == 1


@pytest.mark.parametrize("name", TABLES)
def test_a_single_run_is_a_table(tmp_path: Path, name: str) -> None:
    folder = write_run(tmp_path / "run", name, scored(0.7, 100.0, OBJECTS), [f"experiment={name}"])
    told = unpadded(describe_reproductions(tmp_path, "markdown"))
    assert f"Made by `hlp run experiment={name}`." in told
    assert {"table1": "| cat | 20 | 0.979 | 0.900 |", "table2": "| ADD(-S) | 0.632 | 0.566 |"}[
        name
    ] in told
    assert all((folder / f"{name}.{ending}").stat().st_size for ending in ENDINGS)


@pytest.mark.parametrize("name", TABLES)
def test_a_table_is_told_at_the_end_of_its_run(tmp_path: Path, name: str) -> None:
    folder = write_run(tmp_path / "run", name, scored(0.7, 100.0, OBJECTS))
    told = describe_table(folder)
    lines = told.splitlines()
    assert TABLES[name] in lines[0]
    assert any(line.split() == {
        "table1": ["cat", "20", "0.979", "0.900", "0.700-0.950"],
        "table2": ["ADD(-S)", "0.632", "0.566", "0.700", "0.600-0.740"],
    }[name] for line in lines), told  # fmt: skip
    assert max(map(len, lines)) <= TERMINAL


def test_other_runs_end_without_a_table_of_the_papers(tmp_path: Path) -> None:
    boxes(tmp_path / "sweep")
    assert describe_table(tmp_path / "sweep") == ""


def test_two_methods_of_a_table_stand_side_by_side(tmp_path: Path) -> None:
    folder = write_sweep(tmp_path / "sweep", ["method"], ["experiment=table2", "method=paper,hlp"])
    for i, method in enumerate(("paper", "hlp")):
        write_run(folder / str(i), "table2", scored(0.5, 9.0, OBJECTS), [f"method={method}"])
    told = unpadded(describe_reproductions(tmp_path, "markdown"))
    assert "| method paper | 95 % | method hlp | 95 % |" in told


def test_other_experiments_are_none_of_the_papers(tmp_path: Path) -> None:
    folder = write_run(tmp_path / "run", "demo", scored(0.7, 100.0, OBJECTS))
    assert describe_reproductions(tmp_path, "text") == ""
    assert write_reproductions(folder) == []
    assert not list(folder.glob("demo.*"))


@pytest.mark.parametrize("name", [*TRENDS, *TABLES])
def test_the_experiment_is_named_as_its_file_and_sweeps_what_it_shows(name: str) -> None:
    with initialize_config_dir(str(config_folder()), version_base="1.3"):
        config = compose(
            "config", overrides=[f"experiment={name}", "output=out"], return_hydra_config=True
        )
    params = OmegaConf.to_container(config.hydra.sweeper.params or OmegaConf.create())
    assert config.name == name
    if name in TRENDS:
        assert set(params) <= set(TRENDS[name].keys)
        values = [each for given in params.values() for each in str(given).split(",")]
        assert len(values) >= 3
    else:
        assert params == {}


def test_one_key_moves_both_sides_of_the_box() -> None:
    """Another pair is a matter of the other key beside it."""
    with initialize_config_dir(str(config_folder()), version_base="1.3"):
        for given, box in (
            ([], (2, 2)),
            (["method=paper"], (2, 2)),
            (["refinement.tau_mm=7"], (2, 7)),
        ):
            overrides = ["experiment=fig9c", "output=out", "refinement.theta_deg=2", *given]
            settings = build_settings(compose("config", overrides=overrides)).refinement
            assert (settings.theta_deg, settings.tau_mm) == box
