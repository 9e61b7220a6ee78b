"""Figures in README and the documentation are those of the result files beside them.

`<!-- figures: results/FILE … -->` above a table or paragraph names the files that its figures come
from. A result is written without a leading zero (.971), a setting with one (0.08).
"""

import csv
import json
import re
from collections.abc import Iterator
from pathlib import Path

import pytest
from markdown_pages import PAGES, ROOT

DOCS = ROOT / "docs"
_MARK = re.compile(r"<!-- figures: (.+?) -->\n")
_RESULT = re.compile(r"(?<![\w.])[+−-]?\.\d{2,3}(?!\d)")
_CELL = re.compile(r"[+−-]?\d*\.?\d+")


def marked_blocks(text: str) -> Iterator[tuple[list[str], str]]:
    """The files that a mark names, and the table or paragraph below it."""
    for mark in _MARK.finditer(text):
        below = text[mark.end() :].lstrip("\n")
        yield mark[1].split(), below.partition("\n\n")[0]


def without_marked_blocks(text: str) -> str:
    """A page without its code, its marked blocks and its comments."""
    for _, block in marked_blocks(text):
        text = text.replace(block, "")
    return re.sub(r"```.*?```|<!--.*?-->", "", text, flags=re.DOTALL)


def numbers_of(path: Path) -> set[float]:
    """Every number in a JSON or CSV file."""
    if path.suffix == ".json":
        found: set[float] = set()
        waiting = [json.loads(path.read_text())]
        while waiting:
            value = waiting.pop()
            if isinstance(value, dict | list):
                waiting += list(value.values() if isinstance(value, dict) else value)
            elif isinstance(value, int | float):
                found.add(float(value))
        return found
    cells = [cell for row in csv.reader(path.read_text().splitlines()) for cell in row]
    return {float(cell) for cell in cells if re.fullmatch(r"[+-]?\d*\.?\d+(e-?\d+)?", cell)}


def shown_in(block: str) -> Iterator[str]:
    """Results in a paragraph; in a table, also cells that are nothing but a number."""
    yield from _RESULT.findall(block)
    if block.startswith("|"):
        cells = (cell.strip(" *") for cell in block.replace("\n", "|").split("|"))
        yield from (cell for cell in cells if _CELL.fullmatch(cell) and not _RESULT.match(cell))


def is_there(shown: str, numbers: set[float]) -> bool:
    """Whether a number rounds to what is shown, up to half a unit of its last digit."""
    value = float(shown.replace("−", "-"))
    step = 10.0 ** -len(shown.partition(".")[2])
    return any(abs(value - number) <= step / 2 + 1e-9 for number in numbers)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_figures_are_those_of_the_result_files(page):
    for files, block in marked_blocks(page.read_text()):
        numbers = set().union(*(numbers_of(DOCS / file) for file in files))
        wrong = [shown for shown in shown_in(block) if not is_there(shown, numbers)]
        assert not wrong, f"{page.name}: {files} do not hold {wrong}"


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_no_result_stands_outside_of_a_marked_block(page):
    assert _RESULT.findall(without_marked_blocks(page.read_text())) == []


def test_a_wrong_figure_would_be_found(tmp_path):
    (tmp_path / "a.csv").write_text("name,recall\ncat,0.9706\nall,1309\n")
    numbers = numbers_of(tmp_path / "a.csv")
    assert is_there(".971", numbers) and is_there("1309", numbers)
    assert not is_there(".970", numbers) and not is_there("1308", numbers)
    assert list(shown_in("| cat | .971 | 1309 |\n| b | 8 objects |")) == [".971", "1309"]
    assert _RESULT.findall("p > 0.08, .97 and v1.234, 3.14") == [".97"]
