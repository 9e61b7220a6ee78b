"""Every progress line says what it is for, and is drawn on terminals only."""

import ast
from collections.abc import Iterator
from pathlib import Path

import hlp

PACKAGE = Path(hlp.__file__).parent
QUIET = ("None", "hidden", "not sys.stderr.isatty()")  # values of `disable`


def lines_drawn() -> Iterator[tuple[str, ast.Call]]:
    for path in sorted(PACKAGE.rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Call) and ast.unparse(node.func) == "tqdm":
                yield f"{path.relative_to(PACKAGE)}:{node.lineno}", node


def test_every_progress_line_has_a_purpose_and_is_quiet_without_a_terminal() -> None:
    found = dict(lines_drawn())
    assert len(found) > 15
    for place, call in found.items():
        given = {each.arg: ast.unparse(each.value) for each in call.keywords}
        assert "desc" in given or len(call.args) > 1, f"{place} does not say what for"
        assert given.get("disable", "").startswith(QUIET), f"{place} is never quiet"
