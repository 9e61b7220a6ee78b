"""Figures in README and the documentation are those of the result files beside them.

`<!-- figures: results/FILE … -->` above a table or paragraph names the files that its figures come
from. A result is written without a leading zero (.971), a setting with one (0.08).
"""

import csv
import json
import re
from collections.abc import Iterator
from itertools import product
from pathlib import Path

import pytest
from markdown_pages import PAGES, ROOT

from hlp.reporting.bop_table import PUBLISHED

DOCS = ROOT / "docs"
_MARK = re.compile(r"<!-- figures: (.+?) -->\n")
_RESULT = re.compile(r"(?<![\w.])[+−-]?\.\d{2,3}(?!\d)")
_NUMBER = re.compile(r"[+-]?\d*\.?\d+(e-?\d+)?")
_BETWEEN = re.compile(r"(?<=\d)-(?=\d)")  # of an interval's limits
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


def rows_of(path: Path) -> list[set[float]]:
    """The numbers in each row of a CSV file; all those of a JSON file."""
    if path.suffix == ".json":
        found: set[float] = set()
        waiting = [json.loads(path.read_text())]
        while waiting:
            value = waiting.pop()
            if isinstance(value, dict | list):
                waiting += list(value.values() if isinstance(value, dict) else value)
            elif isinstance(value, int | float):
                found.add(float(value))
        return [found]
    rows = csv.reader(path.read_text().splitlines())
    numbers = ([n for cell in row for n in _BETWEEN.split(cell)] for row in rows)
    return [{float(number) for number in row if _NUMBER.fullmatch(number)} for row in numbers]


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


def are_there(shown: str, files: list[list[set[float]]]) -> bool:
    """Whether all results of a line stand in one row of each of the files.

    A paragraph may tell of several rows.
    """
    results = list(shown_in(shown))
    if not shown.startswith("|"):
        files = [[set().union(*rows)] for rows in files]
    chosen = (set().union(*rows) for rows in product(*files))
    return any(all(is_there(result, row) for result in results) for row in chosen)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_figures_are_those_of_the_result_files(page):
    for names, block in marked_blocks(page.read_text()):
        files = [rows_of(DOCS / name) for name in names]
        lines = block.splitlines() if block.startswith("|") else [block]
        wrong = [line for line in lines if not are_there(line, files)]
        assert not wrong, f"{page.name}: {names} have no row with what {wrong} show"


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_no_result_stands_outside_of_a_marked_block(page):
    assert _RESULT.findall(without_marked_blocks(page.read_text())) == []


def test_a_wrong_figure_would_be_found(tmp_path):
    (tmp_path / "a.csv").write_text("name,recall\ncat,0.9706,12\nall,0.9,1309\n")
    files = [rows_of(tmp_path / "a.csv")]
    assert are_there("| cat | .971 | 12 |", files) and are_there("all: .90, cat: .971", files)
    assert not are_there("| cat | .970 | 12 |", files) and not are_there("| .90 | 12 |", files)
    assert list(shown_in("| cat | .971 | 1309 |\n| b | 8 objects |")) == [".971", "1309"]
    assert _RESULT.findall("p > 0.08, .97 and v1.234, 3.14") == [".97"]


def test_published_figures_are_those_that_runs_are_compared_with():
    _, *rows = csv.reader((DOCS / "results" / "published.csv").read_text().splitlines())
    read = [(name, float(ar), float(s) if s else None, on) for name, ar, s, on in rows]
    assert tuple(read) == PUBLISHED
