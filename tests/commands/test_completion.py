import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

import pytest

import hlp
from hlp.commands import completion
from hlp.commands.completion_words import configuration_words

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


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("hlp run refinement=i", "refinement=icp"),
        ("hlp -m refinement.pa", "refinement.particles= refinement.patience="),
        ("hlp run refinement/", "refinement/cost= refinement/verification="),
        ("hlp run se", "seed="),
        ("hlp run task=search task.sp", "task.space."),
        ("hlp run refinement=icp refinement.pa", ""),
        ("hlp run refinement=icpp refinement.pa", ""),
        ("hlp run refinement=pso,icp refinement.pa", "refinement.particles= refinement.patience="),
        ("hlp run data/ob", "data/objects="),
    ],
)
def test_groups_alternatives_and_keys_of_the_configuration(
    line: str,
    words: str,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    tmp_path: Path,
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setenv("COMP_LINE", line)
    for _ in range(2):  # composed, and from the cache
        completion.command(["-sc", "query=bash"], COMMANDS)
        assert capsys.readouterr().out == f"{words}\n"


@pytest.mark.parametrize("damage", ["", "{", "[]", '{"state": 1}', '{"keys": {"": [1]}}'])
def test_keys_are_composed_again_for_another_code_or_choice_or_a_damaged_file(
    damage: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    asked: list[list[str]] = []

    def compose(choices: Sequence[str]) -> list[str]:
        asked.append([*choices])
        return ["seed", "refinement.tau_mm"]

    folder = tmp_path / "conf"
    (folder / "refinement").mkdir(parents=True)
    (folder / "refinement" / "icp.yaml").write_text("a: 1\n")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    kept = tmp_path / "cache" / "hlp" / "completion.json"

    def ask(*words: str) -> list[str]:
        return configuration_words(words, folder, compose)

    assert ask("s") == ask("s") == ["seed="]
    assert ask("refinement=icp", "ref") == ["refinement.", "refinement="]
    assert asked == [[], ["refinement=icp"]]
    (folder / "refinement" / "icp.yaml").write_text("a: 12\n")
    assert ask("s") == ["seed="] and len(asked) == 3
    kept.write_text(damage)
    assert ask("s") == ask("s") == ["seed="] and len(asked) == 4


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
