import json
from pathlib import Path
from typing import Any
from unittest.mock import Mock

import pytest
from filelock import FileLock
from omegaconf import OmegaConf

from hlp.errors import InputError
from hlp.studies import sweep
from hlp.studies.sweep import SweepCallback, unfinished_sweep
from written_sweeps import change

ASKED = ("seed=0,1", "refinement=icp")


@pytest.fixture
def stopped(tmp_path: Path) -> Path:
    """A sweep that was stopped, beside one that came to its end."""
    for name, status in (("old", "FINISHED"), ("new", "STOPPED")):
        folder = tmp_path / "demo" / name
        folder.mkdir(parents=True)
        record = {"overrides": list(ASKED), "swept": ["seed"], "run_id": "1", "status": status}
        (folder / "sweep.json").write_text(json.dumps(record))
    return tmp_path / "demo" / "new"


def test_the_same_command_goes_on(stopped: Path) -> None:
    assert unfinished_sweep(["-m", *ASKED], stopped.parents[1]) == stopped
    assert unfinished_sweep([*ASKED, "--multirun"], stopped.parents[1]) == stopped


def test_another_command_is_another_sweep(stopped: Path) -> None:
    for other in (["seed=0,2", "refinement=icp"], ["seed=0,1"], [*ASKED, "output=there"]):
        assert unfinished_sweep(["-m", *other], stopped.parents[1]) is None


def test_a_sweep_that_came_to_its_end_is_begun_anew(stopped: Path) -> None:
    change(stopped / "sweep.json", status="FINISHED")
    assert unfinished_sweep(["-m", *ASKED], stopped.parents[1]) is None


@pytest.mark.parametrize("content", ["", "[" * 100_000, "[]", "{}", '{"overrides": 1}', "\0\xff"])
def test_a_damaged_record_is_of_no_sweep(stopped: Path, content: str) -> None:
    (stopped / "sweep.json").write_text(content)
    assert unfinished_sweep(["-m", *ASKED], stopped.parents[1]) is None


def test_a_sweep_that_is_running_is_left_alone(stopped: Path) -> None:
    """`RUNNING` without its lock is one that died: killed, or the machine went down."""
    change(stopped / "sweep.json", status="RUNNING")
    assert unfinished_sweep(["-m", *ASKED], stopped.parents[1]) == stopped
    with FileLock(stopped / "sweep.lock"):
        assert unfinished_sweep(["-m", *ASKED], stopped.parents[1]) is None


def test_a_bug_that_keeps_a_sweep_from_opening_shows_where_it_is(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    config: Any = None
    for error, shown in ((ZeroDivisionError("bug"), True), (InputError("in use"), False)):
        monkeypatch.setattr(sweep, "_open_sweep", Mock(side_effect=error))
        with pytest.raises(SystemExit, match="the sweep cannot be opened"):
            SweepCallback().on_multirun_start(config)
        assert ("Traceback" in capsys.readouterr().err) == shown


def test_a_data_set_that_the_data_folder_lacks_is_left_out(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    config = OmegaConf.create({"data_folder": str(tmp_path), "data": {"root": f"{tmp_path}/cup"}})
    monkeypatch.setattr(sweep.HydraConfig, "get", Mock())
    sweep.run_one(config)
    assert "left out: there is no folder" in caplog.text and "cup" in caplog.text
    (tmp_path / "cup").mkdir()
    assert sweep._has_data(config)
    for other in ({"data_folder": None, "data": {"root": "x"}}, {"data_folder": "x", "data": {}}):
        assert sweep._has_data(OmegaConf.create(other))


def test_a_group_without_keys_of_its_own_is_named_by_its_file() -> None:
    """Such as `method` and `ladder`, whose files set keys of other groups."""
    config = OmegaConf.create({"seed": 1, "refinement": {"name": "pso"}})
    given = ["ladder=patience", "refinement=gentle", "seed=1"]
    values = sweep._swept_values(config, given, ["ladder", "refinement", "seed"])
    assert values == {"ladder": "patience", "refinement": "gentle", "seed": "1"}
