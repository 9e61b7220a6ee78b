from pathlib import Path

import pytest

from hlp.errors import MissingFileError
from hlp.reporting.run_list import describe_outputs, run_list
from written_results import scored, write_run, write_sweep


def test_every_run_and_sweep_has_its_line(tmp_path: Path) -> None:
    run = write_run(tmp_path / "demo" / "a", "demo", scored(0.75, 40.0, {"cat": 0.75}))
    sweep = write_sweep(tmp_path / "sweep", ["seed"], ["seed=1,2"])
    write_run(sweep / "0", "demo", scored(0.5, 40.0, {"cat": 0.5}))
    (sweep / "1" / ".hydra").mkdir(parents=True)
    broken = write_run(tmp_path / "demo" / "b", "demo", {})
    (broken / "summary.json").write_text("{")
    rows = {row[0]: list(row[1:]) for row in run_list(tmp_path).rows}
    assert rows.pop("demo/a") == ["finished", "20", "0.750", "0.650-0.790", "40"]
    assert run.is_dir()
    assert {name: row[0] for name, row in rows.items()} == {
        "demo/b": "broken",
        "sweep": "sweep",
        "sweep/0": "finished",
        "sweep/1": "not finished",
    }
    text = describe_outputs(tmp_path, "text")
    assert "5 runs below" in text
    assert max(map(len, text.splitlines()[:-1])) <= 80


def test_an_empty_folder_says_what_makes_a_run(tmp_path: Path) -> None:
    with pytest.raises(MissingFileError, match="`hlp run` makes one"):
        describe_outputs(tmp_path, "text")
