"""A table of text in the layouts that people and papers need."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from tabulate import tabulate

from hlp.errors import InputError

# LaTeX's own fonts lack these signs; tabulate escapes everything else.
_LATEX_SIGNS = str.maketrans({"°": r"$^\circ$", "θ": r"$\theta$", "τ": r"$\tau$"})

TERMINAL = 80
"""Columns of a terminal."""


@dataclass(frozen=True)
class Table:
    """A table of text: the first column is aligned left, the others right."""

    header: Sequence[str]
    rows: Sequence[Sequence[str]]

    def text(self) -> str:
        """The table for a terminal: columns padded with spaces, a rule below the header."""
        lines = [[*self.header], *([*row] for row in self.rows)]
        widths = [max(map(len, column)) for column in zip(*lines, strict=True)]
        lines.insert(1, ["-" * width for width in widths])
        return "\n".join(
            "  ".join(
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
