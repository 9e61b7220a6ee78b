"""A table of text in the layouts that people and papers need."""

import textwrap
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from tabulate import tabulate

from hlp.errors import InputError

# LaTeX's own fonts lack these signs; tabulate escapes everything else.
_LATEX_SIGNS = str.maketrans({"°": r"$^\circ$", "θ": r"$\theta$", "τ": r"$\tau$"})

TERMINAL = 80
"""Columns of a terminal."""
_GAP = "  "  # between two columns
_SHORTEST = 6  # characters of a cell that is cut


@dataclass(frozen=True)
class Table:
    """A table of text: the first column is aligned left, the others right."""

    header: Sequence[str]
    rows: Sequence[Sequence[str]]

    def without(self, *names: str) -> "Table":
        """The table without the columns of these names."""
        kept = [i for i, name in enumerate(self.header) if name not in names]
        return Table([self.header[i] for i in kept], [[row[i] for i in kept] for row in self.rows])

    def fitted(self, *columns: int, width: int = TERMINAL, ends: bool = False) -> "Table":
        """The table with cells of these columns cut, the longest first, until it fits `width`.

        Of paths, the `ends` are kept, which tell them apart. At least a few characters stay, so a
        table of many columns may still be wider.
        """
        lines = [[*self.header], *([*row] for row in self.rows)]
        widths = self._widths()
        while sum(widths) + len(_GAP) * (len(widths) - 1) > width:
            widest = max(columns, key=lambda column: widths[column])
            if widths[widest] <= _SHORTEST:
                break
            widths[widest] -= 1
        for line in lines:
            for column in columns:
                cell, kept = line[column], widths[column] - 1
                if len(cell) > widths[column]:
                    line[column] = f"…{cell[-kept:]}" if ends else f"{cell[:kept]}…"
        return Table(lines[0], lines[1:])

    def parts(self, width: int = TERMINAL) -> list["Table"]:
        """The table, or if it is wider than `width` several: the first column with some others.

        Then names that would take more than a third of the width are cut.
        """
        widths, room, groups = self._widths(), width, list[list[int]]()
        if sum(widths) + len(_GAP) * (len(widths) - 1) <= width:
            return [self]
        first = min(widths[0], max(width // 3, _SHORTEST))
        for column in range(1, len(widths)):
            needed = len(_GAP) + widths[column]
            if not groups or needed > room:
                groups.append([])
                room = width - first
            groups[-1].append(column)
            room -= needed
        lines = [[line[0], *line[1:]] for line in (self.header, *self.rows)]
        for line in lines:
            if len(line[0]) > first:
                line[0] = f"{line[0][: first - 1]}…"
        picked = [[[line[i] for i in (0, *group)] for line in lines] for group in groups or [[]]]
        return [Table(part[0], part[1:]) for part in picked]

    def _widths(self) -> list[int]:
        return [max(map(len, column)) for column in zip(self.header, *self.rows, strict=True)]

    def text(self) -> str:
        """The table for a terminal: columns padded with spaces, a rule below the header."""
        lines = [[*self.header], *([*row] for row in self.rows)]
        widths = self._widths()
        lines.insert(1, ["-" * width for width in widths])
        return "\n".join(
            _GAP.join(
                cell.rjust(width) if place else cell.ljust(width)
                for place, (cell, width) in enumerate(zip(line, widths, strict=True))
            ).rstrip()
            for line in lines
        )

    def markdown(self) -> str:
        """The table as Markdown."""
        return self._laid_out("pipe")

    def latex(self) -> str:
        """The table as LaTeX's `tabular`, which needs no package."""
        return self._laid_out("latex").translate(_LATEX_SIGNS)

    def _laid_out(self, layout: str) -> str:
        sides = ["left", *["right"] * (len(self.header) - 1)]
        return str(
            tabulate(self.rows, self.header, tablefmt=layout, disable_numparse=True, colalign=sides)
        )


LAYOUTS: dict[str, Callable[[Table], str]] = {"text": Table.text, "markdown": Table.markdown}
"""What the user may choose as `format`."""


def lay_out(table: Table, layout: str) -> str:
    """The table in a layout of `LAYOUTS`; in parts below each other if a terminal is too narrow."""
    tables = table.parts() if layout == "text" else [table]
    return "\n\n".join(map(LAYOUTS[layout], tables))


def prose(words: str, layout: str) -> str:
    """A paragraph in a layout of `LAYOUTS`: in lines for a terminal; Markdown needs none."""
    if layout != "text":
        return words
    return textwrap.fill(words, TERMINAL, break_long_words=False, break_on_hyphens=False)


def check_layout(layout: str) -> None:
    """Raise InputError if a layout is not in `LAYOUTS`."""
    if layout not in LAYOUTS:
        raise InputError(f"format={layout}: choose one of {', '.join(LAYOUTS)}")


def format_share(value: float | None) -> str:
    """A recall or another share with three decimals; empty for None."""
    return "" if value is None else f"{value:.3f}"


def format_interval(ends: Sequence[float]) -> str:
    """The 95 % interval of a share."""
    return "-".join(format_share(end) for end in ends)


def result_share(value: float | None, form: str = "{:.3f}") -> str:
    """A share as result files have it, without a leading zero: `.971`; empty for None."""
    if value is None:
        return ""
    rounded = round(value, 3)
    return (form if rounded else "{:.3f}").format(rounded + 0.0).replace("0.", ".", 1)


def result_difference(found: tuple[float, tuple[float, float]] | None) -> list[str]:
    """A difference of shares and the ends of its interval, as result files have them."""
    if found is None:
        return ["", "", ""]
    return [result_share(value, "{:+.3f}") for value in (found[0], *found[1])]
