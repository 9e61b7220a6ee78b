"""MkDocs' hook: pages written at build time, from the settings, conf/ and the commands' help."""

import os
import re
import subprocess
import sys
from collections.abc import Iterator
from itertools import takewhile
from pathlib import Path
from typing import Any, get_type_hints

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files

sys.path.insert(0, str(Path(__file__).parent))

from notebook_pages import notebook_pages
from settings_reference import Table, as_markdown, settings_classes, tables_of

from hlp.cli import COMMANDS
from hlp.config.composition import rows
from hlp.config.settings import RunSettings

ROOT = Path(__file__).parents[2]
CONF = ROOT / "conf"
OVERVIEW = """\
# Configuration

`hlp run` composes its configuration from one alternative of each group. Choose another one with
`GROUP=NAME` and change a value with `KEY=VALUE`. Unknown keys, and values that have the wrong type
or are out of range, are refused before anything is computed. `hlp run --cfg job` prints the whole
configuration.

Keys that end in `_mm` are in millimetres, those in `_deg` in degrees. P marks what the paper says
and D what we decided.
"""


def on_config(config: MkDocsConfig) -> MkDocsConfig:
    """Fill the navigation's `Configuration` with the generated pages."""
    for entry in config.nav or []:
        if "Configuration" in entry:
            groups = sorted(_groups())
            pages = [{group: f"configuration/{group}.md"} for group in groups]
            entry["Configuration"] = ["configuration/index.md", *pages]
    return config


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the generated pages."""
    for path, text in generated_pages():
        files.append(File.generated(config, path, content=text))
    return files


def generated_pages() -> Iterator[tuple[str, str | bytes]]:
    """Paths in the site and content of all generated pages, and of their pictures."""
    hints = _groups()
    yield "configuration/index.md", _overview(hints)
    for group, hint in hints.items():
        yield f"configuration/{group}.md", _group_page(group, hint)
    yield "command-line.md", _command_line()
    yield "changes.md", (ROOT / "CHANGELOG.md").read_text()
    yield from notebook_pages(ROOT / "notebooks")


def _groups() -> dict[str, Any]:
    """The config groups' types by name: the run's settings that one chooses among."""
    hints = get_type_hints(RunSettings, include_extras=True)
    return {name: hint for name, hint in hints.items() if _alternatives(name)}


def _overview(hints: dict[str, Any]) -> str:
    top, *nested = tables_of(RunSettings, "")
    own = tuple(key for key in top.keys if key.name not in hints)
    lines = [OVERVIEW, "| Group | Alternatives |", "| --- | --- |"]
    for group in hints:
        names = ", ".join(f"`{name}`" for name in _alternatives(group))
        lines.append(f"| [`{group}`]({group}.md) | {names} |")
    for group, purpose in (
        ("method", "chooses a file of several groups at once"),
        ("experiment", "names a run, a figure or a table"),
    ):
        names = ", ".join(f"`{name}`" for name in _alternatives(group))
        lines.append(f"| `{group}`, which {purpose} | {names} |")
    text = "\n".join([*lines, "", ""])
    text += as_markdown(Table("", "Keys beside the groups:", own), "## The run")
    for table in nested:
        if _prefix(table).partition(".")[0] not in hints:
            text += "\n" + as_markdown(table, f"## `{_prefix(table)}`")
    return text


def _prefix(table: Table) -> str:
    return table.keys[0].name.rpartition(".")[0] if table.keys else table.title


def _alternatives(group: str) -> dict[str, str]:
    """What the alternatives of a group are, by name: the first sentence about each."""
    files = {path.stem: _comment(path) for path in (CONF / group).glob("*.yaml")}
    described = {**files, **rows().get(group, {})}
    return {name: _first_sentence(described[name]) for name in sorted(described)}


def _group_page(group: str, hint: Any) -> str:
    lines = [f"# {group}", ""]
    for name, what in _alternatives(group).items():
        lines += [f"**`{group}={name}`**: {what}", ""]
    text = "\n".join([*lines, "## Keys", "", ""])
    classes = list(dict.fromkeys(settings_classes(hint)))
    if not classes:
        raise ValueError(f"no settings class for the config group {group}: {hint}")
    shown: set[Table] = set()  # refiners share the tables of their costs
    for kind in classes:
        outer, *inner = tables_of(kind, f"{group}.")
        text += as_markdown(outer, f"### {outer.title}") + "\n"
        for table in inner:
            if table not in shown:
                text += as_markdown(table, f"#### `{_prefix(table)}` ({table.title})") + "\n"
        shown.update(inner)
    return text + _group_files(group)


def _group_files(group: str) -> str:
    paths = sorted((CONF / group).rglob("*.yaml"))
    text = "## Files\n\n" if paths else ""
    for path in paths:
        shown = path.read_text().rstrip().replace("\n", "\n    ")
        name = path.relative_to(ROOT).as_posix()
        text += f'??? note "{name}"\n    ```yaml\n    {shown}\n    ```\n\n'
    return text


def _comment(path: Path) -> str:
    """The comment at a file's head."""
    lines = (line for line in path.read_text().splitlines() if not line.startswith("# @package"))
    return " ".join(line.lstrip("# ") for line in takewhile(lambda line: line[:1] == "#", lines))


def _first_sentence(text: str) -> str:
    return re.split(r"(?<=[.:])\s+(?=[A-Z])", text)[0].rstrip(":") or "—"


def _command_line() -> str:
    text = "# Command line\n\n" + _block(_help("--help"))
    for name in COMMANDS:
        text += f"\n## hlp {name}\n\n" + _block(_help(name, "--help"))
    return text


def _block(text: str) -> str:
    return f"```text\n{text.rstrip()}\n```\n"


def _help(*arguments: str) -> str:
    command = [sys.executable, "-c", "from hlp.cli import main; main()", *arguments]
    environment = {**os.environ, "HYDRA_FULL_ERROR": "1"}
    done = subprocess.run(
        command, capture_output=True, text=True, check=True, env=environment, cwd=ROOT
    )
    return done.stdout
