"""No circle of imports; modules and functions short enough to be read in one go."""

import ast
from collections import Counter
from collections.abc import Iterator
from graphlib import TopologicalSorter
from importlib import import_module
from pathlib import Path

SOURCE = Path(__file__).parents[2] / "src"
TESTS = SOURCE.parent / "tests"
OF_NO_PACKAGE = {"architecture", "browser", "docs", "faults", "fuzzing", "integration", "notebooks"}
"""Folders of tests that look at several packages; the others mirror src/hlp."""
LONG_FUNCTIONS = {"search": 43}
"""Functions above 40 lines, docstring and all, and what they may have at most."""


def modules() -> dict[str, Path]:
    """Every module by its dotted name."""
    found = {}
    for path in SOURCE.rglob("*.py"):
        name = ".".join(path.relative_to(SOURCE).with_suffix("").parts)
        found[name.removesuffix(".__init__")] = path
    return found


CIRCLES = {
    "hlp.commands.ending": {"hlp.commands.composing"},  # Hydra's errors in words
    "hlp.stages.detection": {"hlp.stages.frame_task"},  # a worker runs the stages that start it
}
"""Imports in functions that close a circle."""


def test_no_modules_import_each_other_in_a_circle() -> None:
    """By their imports, in functions too; `prepare` raises CycleError with the circle."""
    known = modules()
    graph: dict[str, set[str]] = {}
    for name, path in known.items():
        graph[name] = set()
        at_run_time = [s for s in ast.parse(path.read_text()).body if not isinstance(s, ast.If)]
        for statement in (inner for node in at_run_time for inner in ast.walk(node)):
            if isinstance(statement, ast.ImportFrom) and statement.module in known:
                names = (f"{statement.module}.{alias.name}" for alias in statement.names)
                graph[name] |= {full if full in known else statement.module for full in names}
        graph[name] -= CIRCLES.get(name, set())
    assert len(graph) > 100
    TopologicalSorter(graph).prepare()


def test_benchmarks_import_what_there_is() -> None:
    """They are run by hand, so that a module that moves would go unnoticed."""
    paths = sorted((SOURCE.parent / "benchmarks").glob("*.py"))
    nodes = (node for path in paths for node in ast.walk(ast.parse(path.read_text())))
    imports = [node for node in nodes if isinstance(node, ast.ImportFrom) and node.module]
    ours = [node for node in imports if str(node.module).split(".")[0] == "hlp"]
    assert len(ours) > 20
    for node in ours:
        module = import_module(str(node.module))
        assert [alias.name for alias in node.names if not hasattr(module, alias.name)] == []


def test_modules_are_short() -> None:
    lines = {name: len(path.read_text().splitlines()) for name, path in modules().items()}
    assert {name: n for name, n in lines.items() if n > 300} == {}


def functions(path: Path) -> Iterator[tuple[str, int]]:
    """Name and lines of every function of a module, inner ones too."""
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.FunctionDef) and node.end_lineno is not None:
            yield node.name, node.end_lineno - node.lineno + 1


def test_functions_are_short() -> None:
    lines = {
        f"{module}.{name}": n
        for module, path in modules().items()
        for name, n in functions(path)
        if n > LONG_FUNCTIONS.get(name, 40)
    }
    assert lines == {}


def test_test_files_have_names_of_their_own() -> None:
    """Tests of no package are modules of one name space."""
    names = Counter(path.name for path in TESTS.rglob("test_*.py"))
    assert [name for name, count in names.items() if count > 1] == []


def test_tests_lie_where_the_package_lies_that_they_are_of() -> None:
    """One that is named after a module lies beside a module of that name."""
    packages: dict[str, set[str]] = {}
    for path in (SOURCE / "hlp").rglob("*.py"):
        folder = str(path.parent.relative_to(SOURCE / "hlp"))
        packages.setdefault(path.stem, set()).add(folder)
    for path in TESTS.rglob("test_*.py"):
        if (folder := str(path.parent.relative_to(TESTS))) not in OF_NO_PACKAGE:
            module = path.stem.removeprefix("test_")
            assert folder in packages.get(module, packages["__init__"]), path
