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
    ("shell", "line", "words"),
    [
        ("bash", "hlp r", "run report runs"),
        ("zsh", "hlp r", "run report runs"),
        ("bash", "hlp ", "run report runs predict doctor -m"),
        ("bash", "hlp report out", "output="),
        ("fish", "hlp doctor lea", "learnt="),
        ("bash", "hlp doctor x", ""),
        ("bash", "hlp run refinement=i", "refinement=icp"),
        ("zsh", "hlp run voting=", "voting=joint voting=paper voting=sequential"),
        ("bash", "hlp -m refinement.pa", "refinement.particles= refinement.patience="),
        ("bash", "hlp bench refinement/", "refinement/cost= refinement/verification="),
        ("fish", "hlp bench refinement/", "refinement/cost= refinement/verification="),
        ("bash", "hlp run task=search task.sp", "task.space."),
        ("bash", "hlp run refinement=icp refinement.pa", ""),
        ("bash", "hlp run refinement=icpp refinement.pa", ""),
    ],
)
def test_commands_groups_alternatives_and_keys(
    shell: str,
    line: str,
    words: str,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """Bash reads all words in one line, the others one in each."""
    monkeypatch.setenv("COMP_LINE", line)
    monkeypatch.setattr("sys.argv", ["hlp"])
    completion.complete(["-sc", f"query={shell}"], COMMANDS)
    said = capsys.readouterr().out
    assert said == f"{words if shell == 'bash' else words.replace(' ', chr(10))}\n"


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
    assert done.stdout.split() == [f"executor={name}" for name in alternatives]
