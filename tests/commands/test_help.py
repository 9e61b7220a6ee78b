"""What every `hlp COMMAND --help` has: a usage, examples, and lines that fit a terminal."""

import pytest
import yaml

from hlp.cli import COMMANDS, main
from hlp.commands import help_text
from hlp.files import config_folder, shipped_folder

Out = pytest.CaptureFixture[str]


@pytest.mark.parametrize("name", COMMANDS)
def test_help_has_a_usage_two_examples_and_lines_that_fit(name: str, capsys: Out) -> None:
    main([name, "--help"])
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].startswith(f"usage: hlp {name}")
    assert sum(line.startswith((f"hlp {name}", "hlp -m")) for line in lines) >= 2
    assert not [line for line in lines if len(line) > 80 and "://" not in line]


def test_help_of_run_lists_every_alternative_once() -> None:
    lines = help_text("run").replace("\n    ", " ").splitlines()
    (ladder,) = [line for line in lines if line.startswith("ladder: ")]
    rows = sorted(yaml.safe_load((config_folder() / "ladder.yaml").read_text()))
    assert ladder.removeprefix("ladder: ").split(", ") == rows
    assert "refinement: icp, none, paper, pso" in lines  # of files
    assert "voting: joint, paper, sequential" in lines  # of rows
    assert "refinement/cost: hlp, paper" in lines  # of both


def test_help_of_notebooks_names_each_of_them() -> None:
    for path in shipped_folder("notebooks").glob("*.ipynb"):
        assert f"  {path.stem} " in help_text("notebooks")
