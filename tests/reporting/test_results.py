from pathlib import Path

import pytest

from hlp.reporting.results import result_folders
from hlp.reporting.sweeps import read_sweeps
from written_results import scored, write_run, write_sweep

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
    with pytest.raises(ValueError, match="broken holds no results"):
        read_sweeps(run)


def test_what_measures_stages_has_no_summary_and_is_passed_over(tmp_path: Path) -> None:
    run = write_run(tmp_path / "sweep" / "0", "oracle", SUMMARY)
    (run / "summary.json").unlink()
    assert result_folders(tmp_path) == []
    folder = write_sweep(tmp_path / "other", [], [])
    run.rename(folder / "0")
    assert read_sweeps(folder) == []
