"""`experiment=bop` killed while it learns, while it finds, and while its files are written."""

import signal

import pytest
from process import BOP_PLACES, stop_hlp

from bop_sets import SMALLEST, write_bop_set
from forked_hlp import succeed
from table_text import csv_rows

pytestmark = [pytest.mark.slow, pytest.mark.thorough]

TIMED = {"s", "CPU s", "ms", "ms 95 %", "CPU ms", "load", "time"}
"""Columns that differ from run to run."""


def _finished(folder):
    """When each file of a finished stage, frame or run was written."""
    runs = [path.parent for path in folder.glob("out/*/manifest.json")]
    found = [path for part in (folder / "work", *runs) for path in part.rglob("*.*")]
    return {
        str(path).replace(".partial", ""): path.stat().st_mtime_ns
        for path in found
        if path.is_file()
        and path.suffix not in (".log", ".lock")
        and not any(part.startswith(".") for part in path.parts)
        and ("classifier" not in path.parts or ".partial" not in str(path))
    }


def _untimed(path):
    rows = csv_rows(path)
    return [{key: value for key, value in row.items() if key not in TIMED} for row in rows]


def test_nothing_is_lost_and_nothing_that_was_finished_is_done_twice(tmp_path):
    folders = [tmp_path / "whole", tmp_path / "stopped"]
    for name in ("tudl", "itodd"):
        write_bop_set(name, tmp_path / "sets" / name)
    command = ("run", "-m", "experiment=bop", f"data_folder={tmp_path / 'sets'}", *SMALLEST)
    for folder in folders:
        folder.mkdir()
    whole, stopped = folders
    succeed(whole, *command)
    done, steps = {}, []
    for place in BOP_PLACES:
        stop_hlp(stopped, place, signal.SIGKILL, *command)
        found = _finished(stopped)
        assert done.items() <= found.items(), place
        done = found
        steps.append(len(found))
    assert 0 < steps[0] < steps[1] < steps[2]
    ended = succeed(stopped, *command)
    assert ended.stdout.count("finished already") == 2, ended.stdout
    assert done.items() <= _finished(stopped).items()
    tables = sorted(path.name for path in (whole / "out").glob("*.csv"))
    assert {"bop.csv", "hlp_itodd-test.csv", "hlp_tudl-test.csv"} <= set(tables)
    assert tables == sorted(path.name for path in (stopped / "out").glob("*.csv"))
    for name in tables:
        assert _untimed(stopped / "out" / name) == _untimed(whole / "out" / name), name
    for path in (stopped / "out").glob("hlp_*.csv"):
        assert all(float(line.split(",")[-1]) > 0 for line in path.read_text().splitlines()[1:])
    assert (stopped / "out" / "hlp_bop.zip").is_file()
