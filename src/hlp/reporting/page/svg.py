"""Small charts as SVG text: axes, lines, bars and points, a few kilobytes each."""

import math
from collections.abc import Iterable, Sequence
from html import escape

Point = tuple[float, float]

BLUE, ORANGE, GREEN, RED, PURPLE, SKY, GREY = (
    "#0072b2", "#e69f00", "#009e73", "#d55e00", "#cc79a7", "#56b4e9", "#8a8f98",
)  # fmt: skip
"""Colours that the colour-blind tell apart too (Okabe and Ito, 2008)."""
_LEFT, _RIGHT, _TOP, _BOTTOM = 52, 14, 10, 40


class Chart:
    """A chart in data coordinates. Parts are drawn in the order of the calls.

    `x` and `y` are the ranges of the axes, `left` the room for their labels (px).
    """

    def __init__(
        self, width: int, height: int, x: Point, y: Point, left: int = _LEFT, right: int = _RIGHT
    ) -> None:
        self.width, self.height = width, height
        self._x, self._y = x, y
        self._box = (left, _TOP, width - right, height - _BOTTOM)
        self._parts: list[str] = []

    def place(self, x: float, y: float) -> Point:
        """Pixels of a point of the data."""
        left, top, right, bottom = self._box
        across = (x - self._x[0]) / (self._x[1] - self._x[0])
        up = (y - self._y[0]) / (self._y[1] - self._y[0])
        return left + across * (right - left), bottom - up * (bottom - top)

    def axes(
        self,
        x_label: str,
        y_label: str,
        x_ticks: Iterable[tuple[float, str]] = (),
        y_ticks: Iterable[tuple[float, str]] = (),
    ) -> None:
        """Axes with labels; ticks have a place and a text, those of y also a line across."""
        left, top, right, bottom = self._box
        for value, text in y_ticks:
            y = self.place(self._x[0], value)[1]
            self._parts.append(f'<path class="g" d="M{left} {y:.1f}H{right}"/>')
            self._put(left - 6, y + 4, text, "end")
        for value, text in x_ticks:
            self._put(self.place(value, self._y[0])[0], bottom + 16, text, "middle")
        self._parts.append(f'<path class="a" d="M{left} {bottom}H{right}"/>')
        self._put((left + right) / 2, self.height - 6, x_label, "middle", "l")
        if y_label:
            middle = (top + bottom) / 2
            turned = f'transform="rotate(-90 12 {middle:.0f})"'
            self._put(12, middle, y_label, "middle", "l", turned)

    def line(
        self, points: Sequence[Point], color: str, width: float = 2, dash: str = "", title: str = ""
    ) -> None:
        """A polyline."""
        if not points:
            return
        path = "L".join("{:.1f} {:.1f}".format(*self.place(*point)) for point in points)
        dashed = f' stroke-dasharray="{dash}"' if dash else ""
        self._parts.append(
            f'<path d="M{path}" fill="none" stroke="{color}" stroke-width="{width}"{dashed}>'
            f"{_title(title)}</path>"
        )

    def bar(self, low: Point, high: Point, color: str, title: str = "") -> None:
        """A filled rectangle between two corners."""
        (x0, y0), (x1, y1) = self.place(*low), self.place(*high)
        x, y = min(x0, x1), min(y0, y1)
        self._parts.append(
            f'<rect x="{x:.1f}" y="{y:.1f}" width="{abs(x1 - x0):.1f}" height="{abs(y1 - y0):.1f}"'
            f' fill="{color}">{_title(title)}</rect>'
        )

    def dot(self, at: Point, color: str, radius: float = 4, title: str = "") -> None:
        """A disc."""
        x, y = self.place(*at)
        self._parts.append(
            f'<circle cx="{x:.1f}" cy="{y:.1f}" r="{radius:.1f}" fill="{color}">'
            f"{_title(title)}</circle>"
        )

    def diamond(self, at: Point, title: str = "") -> None:
        """An open diamond: a number that somebody else has published."""
        x, y = self.place(*at)
        self._parts.append(
            f'<path class="d" d="M{x:.1f} {y - 5:.1f}l5 5l-5 5l-5 -5z">{_title(title)}</path>'
        )

    def text(
        self,
        at: Point,
        words: str,
        anchor: str = "start",
        shift: Point = (0, 4),
        light: bool = False,
    ) -> None:
        """Words at a point, shifted by some pixels; light ones stand on dark colours."""
        x, y = self.place(*at)
        self._put(x + shift[0], y + shift[1], words, anchor, "w" if light else "")

    def slanted(self, at: Point, words: str) -> None:
        """Words that begin at a point and rise to the right."""
        x, y = self.place(*at)
        self._put(x, y, words, "start", more=f'transform="rotate(-45 {x:.1f} {y:.1f})"')

    def svg(self) -> str:
        """The chart as an SVG element."""
        box = f'viewBox="0 0 {self.width} {self.height}" width="{self.width}"'
        return f'<svg xmlns="http://www.w3.org/2000/svg" {box}>{"".join(self._parts)}</svg>'

    def _put(
        self, x: float, y: float, words: str, anchor: str, kind: str = "", more: str = ""
    ) -> None:
        named = f' class="{kind}"' if kind else ""
        self._parts.append(
            f'<text x="{x:.1f}" y="{y:.1f}" text-anchor="{anchor}"{named} {more}>'
            f"{escape(words)}</text>"
        )


def ticks(low: float, high: float, about: int = 5) -> list[tuple[float, str]]:
    """Round values between two ends, about so many, with their texts."""
    step = 10.0 ** math.floor(math.log10((high - low) / about))
    step *= next(each for each in (1, 2, 5, 10) if (high - low) / (each * step) <= about)
    first, last = math.ceil(low / step - 1e-9), math.floor(high / step + 1e-9)
    return [(i * step, f"{i * step:.6g}") for i in range(first, last + 1)]


def _title(words: str) -> str:
    return f"<title>{escape(words)}</title>" if words else ""
