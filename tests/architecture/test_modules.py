"""No circle of imports; modules short enough to be read in one go."""

import ast
from graphlib import TopologicalSorter
from pathlib import Path

SOURCE = Path(__file__).parents[2] / "src"
LONG = {
    "hlp.method.detector": 450,  # two thirds are docstrings with examples
    "hlp.method.find.estimator": 370,
    "hlp.records": 310,
    "hlp.refinement.verification": 350,
    "hlp.stages.detection": 350,
    "hlp.stages.training": 305,
}
"""Modules above 300 lines, and what they may have at most; none may join them."""


def modules() -> dict[str, Path]:
    """Every module by its dotted name."""
    found = {}
    for path in SOURCE.rglob("*.py"):
        name = ".".join(path.relative_to(SOURCE).with_suffix("").parts)
        found[name.removesuffix(".__init__")] = path
    return found


def test_no_modules_import_each_other_in_a_circle() -> None:
    """By the imports at the top of modules; `prepare` raises CycleError with the circle."""
    known = modules()
    graph: dict[str, set[str]] = {}
    for name, path in known.items():
        graph[name] = set()
        for statement in ast.parse(path.read_text()).body:
            if isinstance(statement, ast.ImportFrom) and statement.module in known:
                names = (f"{statement.module}.{each.name}" for each in statement.names)
                graph[name] |= {each if each in known else statement.module for each in names}
    assert len(graph) > 100
    TopologicalSorter(graph).prepare()


def test_modules_are_short() -> None:
    lines = {name: len(path.read_text().splitlines()) for name, path in modules().items()}
    assert {name: n for name, n in lines.items() if n > LONG.get(name, 300)} == {}
