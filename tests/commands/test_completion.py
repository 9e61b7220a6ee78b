import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import hlp
from hlp.commands import completion

COMMANDS = ["run", "report", "runs", "predict", "doctor"]
SHELLS = {
    "bash": """
eval "$(hlp -sc install=bash)"
COMP_LINE="hlp run executor="; COMP_POINT=${#COMP_LINE}; COMP_CWORD=2
hydra_bash_completion
echo "${COMPREPLY[@]}"
""",
    "zsh": """
autoload -Uz compinit && compinit -u -D
eval "$(hlp -sc install=zsh)"
[[ $_comps[hlp] == _hlp ]] || exit 1
compadd() { while [[ $1 != -- ]]; do shift; done; shift; print -- $@ }
words=(hlp run executor=); CURRENT=3
_hlp
""",
    "fish": """
hlp -sc install=fish | source
complete -C "hlp run executor="
""",
}


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
    completion.complete(["-sc", "query=bash"], COMMANDS)
    assert capsys.readouterr().out == f"{words}\n"


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("hlp run refinement=i", "refinement=icp"),
        ("hlp run voting=", "voting=joint voting=paper voting=sequential"),
        ("hlp -m refinement.pa", "refinement.particles= refinement.patience="),
        ("hlp bench refinement/", "refinement/cost= refinement/verification="),
        ("hlp run task=search task.sp", "task.space."),
        ("hlp run refinement=icp refinement.pa", ""),
        ("hlp run refinement=icpp refinement.pa", ""),
    ],
)
def test_groups_alternatives_and_keys_of_the_configuration(
    line: str, words: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("COMP_LINE", line)
    monkeypatch.setattr("sys.argv", ["hlp"])
    completion.complete(["-sc", "query=bash"], COMMANDS)
    assert capsys.readouterr().out == f"{words}\n"


@pytest.mark.parametrize("shell", ["zsh", "fish"])
@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("hlp r", ["run", "report", "runs"]),
        ("hlp doctor x", [""]),
        ("hlp run refinement/", ["refinement/cost=", "refinement/verification="]),
        ("hlp run hydra/launcher=", ["hydra/launcher=basic", "hydra/launcher=cores"]),
    ],
)
def test_other_shells_than_bash_read_a_word_a_line(
    shell: str,
    line: str,
    words: list[str],
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setenv("COMP_LINE", line)
    monkeypatch.setattr("sys.argv", ["hlp"])
    completion.complete(["-sc", f"query={shell}"], COMMANDS)
    assert capsys.readouterr().out.split("\n")[: len(words)] == words


@pytest.mark.slow
@pytest.mark.parametrize("shell", SHELLS)
def test_shells_complete_the_alternatives_of_a_group(shell: str, tmp_path: Path) -> None:
    if shutil.which(shell) is None:
        pytest.skip(f"{shell} is not installed")
    program = tmp_path / "hlp"
    main = "import sys; sys.argv[0] = 'hlp'; from hlp.cli import main; main()"
    program.write_text(f'#!/bin/sh\nexec {sys.executable} -c "{main}" "$@"\n')
    program.chmod(0o755)
    path = f"{tmp_path}:/usr/bin:/bin"
    done = subprocess.run(
        [shell, "-c", SHELLS[shell]],
        cwd=tmp_path,
        env={"PATH": path, "PYTHONPATH": str(Path(hlp.__file__).parents[1])},
        capture_output=True,
        text=True,
        check=True,
    )
    alternatives = ("dask", "loky", "ray", "serial", "threading")
    assert done.stdout.split() == [f"executor={each}" for each in alternatives]
