"""Every `hlp` command that README and the pages show: its groups, keys and values exist."""

import re
from pathlib import Path

import pytest
from hydra.core.override_parser.overrides_parser import OverridesParser
from markdown_pages import EXAMPLES, commands, write_files

from composed_settings import run_settings
from hlp.cli import COMMANDS
from hlp.commands import MULTIRUN, help_text
from hlp.commands.arguments import split_arguments
from hlp.data.public_sets import find_set

PREFIX = {"bench": ["task=bench"], "search": ["task=search"]}
OWN = ("download", "learn", "predict", "live", "objects", "doctor")
"""They take keys of their own and, partly, overrides."""
CASES = {" ".join(words): (path, words) for path in EXAMPLES for words in commands(path)}


def compose_command(words: list[str], own_files: Path) -> int:
    """Compose what a command names, every value of a sweep once; the number of configurations."""
    command, *arguments = words if words[0] not in MULTIRUN else ["run", *words]
    if command == "search":
        arguments = [f"task/{word}" if word.startswith("space=") else word for word in arguments]
    overrides, searched = [*PREFIX.get(command, [])], []
    remaining = iter(arguments)
    for word in remaining:
        if word == "--config-dir":
            searched = [f"hydra.searchpath=[file://{own_files / next(remaining)}]"]
        elif word not in MULTIRUN and not word.startswith(("manifest=", "compare=")):
            overrides.append(word.replace("…", "X"))
    if "experiment=bop" in words:
        overrides.append("data.root=data/lmo")  # as its own sweep does
    swept = [_values(override) for override in overrides]
    count = max(map(len, swept), default=1)
    for index in range(count):
        chosen = [values[index % len(values)] for values in swept]
        run_settings(*searched, *chosen)
    return count


def check_own(words: list[str]) -> None:
    """Keys are in the command's help, words of `hlp objects` in its usage; the rest composes."""
    shown = help_text(words[0])
    if words[0] == "download":
        public, given = find_set(words[1]), split_arguments(words[2:])
        assert public.files(given.get("images", next(iter(public.archives))))
        assert all(re.search(rf"^  {key} ", shown, re.MULTILINE) for key in given)
        return
    if words[0] == "objects":
        assert f"hlp objects {words[1]}" in shown
        return
    overrides = []
    for key, value in split_arguments(words[1:]).items():
        if not re.search(rf"(^|[\s,\[]){key}[\s,=]", shown + help_text("learn")):
            overrides.append(f"{key}={value}")
    run_settings(*overrides)


def _values(override: str) -> list[str]:
    (parsed,) = OverridesParser.create().parse_overrides([override])
    if not parsed.is_sweep_override():
        return [override]
    key = override.partition("=")[0]
    return [f"{key}={value}" for value in parsed.sweep_string_iterator()]


@pytest.mark.parametrize(("path", "words"), CASES.values(), ids=[*CASES])
def test_command_exists_and_its_configuration_composes(path, words, tmp_path):
    write_files(path, tmp_path)
    if words[0] in OWN:
        check_own(words)
    elif words[0] in MULTIRUN or words[0] != "report":
        assert words[0] in MULTIRUN or words[0] in COMMANDS
        compose_command(words, tmp_path)
    else:
        known = set(re.findall(r"(\w+)=", help_text("report").partition("\n\n")[0]))
        assert {word.partition("=")[0] for word in words[1:]} <= known


def test_commands_of_every_page_are_found():
    assert {"README", "index", "own-object", "sweeps", "mlflow", "adding-alternatives"} <= {
        path.stem for path in EXAMPLES if [*commands(path)]
    }


def test_every_value_of_a_sweep_is_composed(tmp_path):
    assert compose_command(["-m", "refinement=pso,icp,none", "seed=0,1"], tmp_path) == 3
    with pytest.raises(Exception, match="magic"):
        compose_command(["-m", "refinement=pso,magic"], tmp_path)
