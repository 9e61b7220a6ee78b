"""A table of text in the layouts that people and papers need."""

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

    def fitted(self, *columns: int, width: int = TERMINAL) -> "Table":
        """The table with cells of these columns cut, the longest first, until it fits `width`.

        At least a few characters stay, so a table of many columns may still be wider.
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
                if len(line[column]) > widths[column]:
                    line[column] = f"{line[column][: widths[column] - 1]}…"
        return Table(lines[0], lines[1:])

    def _widths(self) -> list[int]:
        return [max(map(len, each)) for each in zip(self.header, *self.rows, strict=True)]

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
