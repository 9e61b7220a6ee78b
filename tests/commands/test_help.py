"""What every `hlp COMMAND --help` has: a usage, examples, and lines that fit a terminal."""

from pathlib import Path

import pytest
import yaml

from hlp.cli import COMMANDS, main
from hlp.commands import composing
from hlp.commands.run import run_help

Out = pytest.CaptureFixture[str]


@pytest.mark.parametrize("name", COMMANDS)
def test_help_has_a_usage_two_examples_and_lines_that_fit(name: str, capsys: Out) -> None:
    main([name, "--help"])
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].startswith(f"usage: hlp {name}")
    assert sum(line.startswith((f"hlp {name}", "hlp -m")) for line in lines) >= 2
    assert not [line for line in lines if len(line) > 80 and "://" not in line]


def test_help_of_run_lists_every_alternative_once() -> None:
    folder = composing.config_folder()
    words = run_help([], folder).replace("\n    ", " ").splitlines()
    (ladder,) = [line for line in words if line.startswith("ladder: ")]
    rows = sorted(yaml.safe_load((folder / "ladder.yaml").read_text()))
    assert ladder.removeprefix("ladder: ").split(", ") == rows


@pytest.mark.parametrize(
    "form", [["--config-dir", "{}"], ["--config-dir={}"], ["hydra.searchpath=[file://{}]"]]
)
def test_help_of_run_lists_alternatives_of_ones_own(form: list[str], tmp_path: Path) -> None:
    (tmp_path / "refinement").mkdir()
    (tmp_path / "refinement" / "quick.yaml").write_text("defaults: [pso]\n")
    given = ["--help", *(each.format(tmp_path) for each in form)]
    assert "refinement: icp, none, paper, pso, quick" in run_help(given, composing.config_folder())
