"""A table of text in the layouts that people and papers need."""

import math
import textwrap
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from tabulate import tabulate

# LaTeX's own fonts lack these signs; tabulate escapes everything else.
_LATEX_SIGNS = str.maketrans({"°": r"$^\circ$", "θ": r"$\theta$", "τ": r"$\tau$"})

TERMINAL = 80
"""Columns of a terminal."""
_GAP = "  "  # between two columns
_SHORTEST = 12  # characters of a cell that is cut


@dataclass(frozen=True)
class Table:
    """A table of text: the first column is aligned left, the others right."""

    header: Sequence[str]
    rows: Sequence[Sequence[str]]

    def without(self, *names: str) -> "Table":
        """The table without the columns of these names."""
        kept = [i for i, name in enumerate(self.header) if name not in names]
        return Table([self.header[i] for i in kept], [[row[i] for i in kept] for row in self.rows])

    def parts(self, width: int = TERMINAL) -> list["Table"]:
        """The table as it fits `width`: names are cut, or there are several of some columns each.

        Only the first column is cut; of paths the ends are kept, which tell them apart.
        """
        widths, room, groups = self._widths(), 0, list[list[int]]()
        others = sum(widths[1:]) + len(_GAP) * len(widths[1:])
        if (first := min(widths[0], max(width - others, _SHORTEST))) + others > width:
            first = min(widths[0], max(width // 3, _SHORTEST))
        for column in range(1, len(widths)):
            needed = len(_GAP) + widths[column]
            if not groups or needed > room:
                groups.append([])
                room = width - first
            groups[-1].append(column)
            room -= needed
        lines = [[_cut(line[0], first), *line[1:]] for line in (self.header, *self.rows)]
        picked = [[[line[i] for i in (0, *group)] for line in lines] for group in groups or [[]]]
        return [Table(part[0], part[1:]) for part in picked]

    def _widths(self) -> list[int]:
        return [max(map(len, column)) for column in zip(self.header, *self.rows, strict=True)]

    def text(self) -> str:
        """The table for a terminal: columns padded with spaces, a rule below the header."""
        widths = self._widths()
        lines = [self.header, ["-" * width for width in widths], *self.rows]
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
        return str(tabulate(self.rows, self.header, layout, disable_numparse=True, colalign=sides))


def _cut(name: str, width: int) -> str:
    if len(name) <= width:
        return name
    return f"…{name[1 - width :]}" if "/" in name else f"{name[: width - 1]}…"


LAYOUTS: dict[str, Callable[[Table], str]] = {"text": Table.text, "markdown": Table.markdown}
"""What the user may choose as `format`."""


def lay_out(table: Table, layout: str) -> str:
    """The table in a layout of `LAYOUTS`; for a terminal `Table.parts` below each other."""
    return "\n\n".join(map(LAYOUTS[layout], table.parts() if layout == "text" else [table]))


def prose(words: str, layout: str) -> str:
    """A paragraph in a layout of `LAYOUTS`: in lines for a terminal; Markdown needs none."""
    if layout != "text":
        return words
    return textwrap.fill(words, TERMINAL, break_long_words=False, break_on_hyphens=False)


def format_share(value: float | None, digits: int = 3) -> str:
    """A recall or another share; empty for None and NaN."""
    return "" if value is None or math.isnan(value) else f"{value:.{digits}f}"


def format_interval(ends: Sequence[float]) -> str:
    """The 95 % interval of a share."""
    return "-".join(format_share(end) for end in ends)
