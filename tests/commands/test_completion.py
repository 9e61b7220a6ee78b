import subprocess
import sys
from pathlib import Path

import pytest

import hlp
from hlp.commands import completion

COMMANDS = ["run", "report", "runs", "predict", "doctor"]
SHELL = """
eval "$(hlp -sc install=bash)"
COMP_LINE="hlp run refinement=i"; COMP_POINT=${#COMP_LINE}; COMP_CWORD=2
hydra_bash_completion
echo "${COMPREPLY[@]}"
"""


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("hlp r", "run report runs"),
        ("hlp ", "run report runs predict doctor -m"),
        ("hlp report out", "output="),
        ("hlp doctor lea", "learnt="),
        ("hlp doctor x", ""),
    ],
)
def test_commands_and_their_own_keys(
    line: str, words: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("COMP_LINE", line)
    completion.command(["-sc", "query=bash"], COMMANDS)
    assert capsys.readouterr().out == f"{words}\n"


@pytest.mark.slow
def test_bash_completes_the_alternatives_of_a_group(tmp_path: Path) -> None:
    program = tmp_path / "hlp"
    main = "import sys; sys.argv[0] = 'hlp'; from hlp.cli import main; main()"
    program.write_text(f'#!/bin/sh\nexec {sys.executable} -c "{main}" "$@"\n')
    program.chmod(0o755)
    path = f"{tmp_path}:/usr/bin:/bin"
    done = subprocess.run(
        ["bash", "-c", SHELL],
        cwd=tmp_path,
        env={"PATH": path, "PYTHONPATH": str(Path(hlp.__file__).parents[1])},
        capture_output=True,
        text=True,
        check=True,
    )
    assert done.stdout.strip() == "refinement=icp"
