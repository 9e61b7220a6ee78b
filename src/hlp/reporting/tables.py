"""Tables of finished runs for the terminal and for Markdown, the paper's figures beside ours."""

import csv
import io
import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from hlp.reporting.figures.trade_off import SWEEP, draw_trade_off
from hlp.reporting.figures.waterfall_bars import CORRECT, PANELS, draw_waterfall
from hlp.reporting.paper import AD_BY_OBJECT

METRICS = {"add": "AD", "5cm5deg": "5cm5deg", "iou50": "IoU.5"}
VOTE_SHARES = {
    "good": "good",
    "good_weight": "good by weight",
    "by_object": "from the object",
    "good_by_object": "good of these",
}
RECALL = "Recall: the share of targets (objects to be found in a frame) with a right pose."


@dataclass(frozen=True)
class Table:
    """A table of text: the first column is aligned left, the others right."""

    header: Sequence[str]
    rows: Sequence[Sequence[str]]

    def text(self) -> str:
        """Columns padded with spaces, a line below the header."""
        lines = [self.header, *self.rows]
        widths = [max(len(cell) for cell in column) for column in zip(*lines, strict=True)]
        rule = "-" * (sum(widths) + 2 * (len(widths) - 1))
        padded = [
            "  ".join(
                cell.rjust(width) if index else cell.ljust(width)
                for index, (cell, width) in enumerate(zip(line, widths, strict=True))
            ).rstrip()
            for line in lines
        ]
        return "\n".join([padded[0], rule, *padded[1:]])

    def markdown(self) -> str:
        """The table as Markdown."""
        rule = ["---", *["---:"] * (len(self.header) - 1)]
        return "\n".join(f"| {' | '.join(line)} |" for line in (self.header, rule, *self.rows))

    def csv(self) -> str:
        """The table as comma-separated values."""
        stream = io.StringIO()
        csv.writer(stream, lineterminator="\n").writerows([self.header, *self.rows])
        return stream.getvalue().removesuffix("\n")

    def latex(self) -> str:
        """The table as LaTeX's `tabular`; it needs no package."""
        columns = "l" + "r" * (len(self.header) - 1)
        lines = [" & ".join(cell.translate(_LATEX) for cell in line) + r" \\" for line in self.rows]
        header = " & ".join(cell.translate(_LATEX) for cell in self.header) + r" \\ \hline"
        begin, end = rf"\begin{{tabular}}{{{columns}}}", r"\end{tabular}"
        return "\n".join([begin, header, *lines, end])


_LATEX = str.maketrans(
    {
        **{sign: f"\\{sign}" for sign in "&%$#_{}"},
        "\\": r"\textbackslash{}",
        "~": r"\textasciitilde{}",
        "^": r"\textasciicircum{}",
        "°": r"$^\circ$",
        "θ": r"$\theta$",
        "τ": r"$\tau$",
    }
)

FORMATS: dict[str, Callable[[Table], str]] = {"text": Table.text, "markdown": Table.markdown}


def report(folder: Path, layout: str) -> str:
    """Tables of every run in or below a folder, oldest first, and all of them side by side.

    `layout` is `text` or `markdown`. Each run's waterfall is drawn into its folder, and recall
    against time into each sweep's. Raises
    ValueError for another layout or a broken summary, and FileNotFoundError where no finished run
    is found.
    """
    if layout not in FORMATS:
        raise ValueError(f"format={layout}: choose one of {', '.join(FORMATS)}")
    paths = sorted(folder.rglob("summary.json"), key=lambda path: path.stat().st_mtime)
    if not paths:
        raise FileNotFoundError(f"no finished run (summary.json) in or below {folder}")
    summaries = {str(path.parent): read_summary(path) for path in paths}
    heading = "## " if layout == "markdown" else ""
    parts = []
    for name, summary in summaries.items():
        parts.append(f"{heading}{name}\n\n{format_summary(summary, layout)}")
        tables = (*waterfall_tables(summary), votes_table(summary))
        parts += [FORMATS[layout](table) for table in tables if table.rows]
        if waterfall_tables(summary):
            draw_waterfall(Path(name), summary["waterfall"])
            parts.append(f"Drawn: {Path(name, 'waterfall.png')} and .svg")
    for sweep in sorted(path.parent for path in folder.rglob(SWEEP)):
        parts += [f"Drawn: {path}" for path in draw_trade_off(sweep)]
    if len(summaries) > 1:
        parts.append(f"{heading}All runs\n\n{FORMATS[layout](runs_table(summaries))}")
    return "\n\n".join(parts)


def read_summary(path: Path) -> dict[str, Any]:
    """Read `summary.json`; raises ValueError naming the file where it is none."""
    try:
        summary: dict[str, Any] = json.loads(path.read_text())
    except ValueError as error:
        raise ValueError(f"{path} is no JSON: {error}") from error
    missing = {"targets", "metrics", "per_object", "timing_ms", "waterfall"} - set(summary)
    if missing:
        raise ValueError(f"{path} is no summary of a run: it lacks {', '.join(sorted(missing))}")
    return summary


def format_summary(summary: Mapping[str, Any], layout: str = "text") -> str:
    """The three tables of one run: recalls per object, time per stage, where targets ended."""
    tables = (objects_table(summary), time_table(summary), total_table(summary))
    objects, times, total = (FORMATS[layout](table) if table.rows else "" for table in tables)
    parts = [RECALL, objects, times, timing_words(summary), total]
    return "\n\n".join(part for part in parts if part)


def objects_table(summary: Mapping[str, Any]) -> Table:
    """Recall of each metric per object, over objects and over targets with its 95 % interval.

    The paper's figures stand beside it where every object is LINEMOD's: another set's duck is
    another duck.
    """
    names = list(summary["per_object"])
    linemod = all(name in AD_BY_OBJECT for name in names)
    metrics = summary["metrics"]
    rows = [
        [
            name,
            str(scores["targets"]),
            *(_share(scores[key]["recall"]) for key in METRICS),
            _share(AD_BY_OBJECT.get(name)),
        ]
        for name, scores in summary["per_object"].items()
    ]
    paper_mean = sum(AD_BY_OBJECT[name] for name in names) / len(names) if linemod else None
    means = [_share(metrics[key]["mean_object"]) for key in METRICS]
    recalls = [_share(metrics[key]["recall"]) for key in METRICS]
    intervals = [interval_words(metrics[key]["ci95"]) for key in METRICS]
    targets = str(summary["targets"])
    rows.append(["mean of objects", targets, *means, _share(paper_mean)])
    rows.append(["all targets", targets, *recalls, ""])
    rows.append(["  95 % interval", "", *intervals, ""])
    table = Table(["object", "targets", *METRICS.values(), "paper AD"], rows)
    return table if linemod else Table(table.header[:-1], [row[:-1] for row in rows])


def time_table(summary: Mapping[str, Any]) -> Table:
    """Median and 95th percentile of each stage's time for one object in one frame, total last."""
    times = dict(summary["timing_ms"])
    if "total" in times:
        times["total"] = times.pop("total")
    rows = [[stage, _ms(time["median"]), _ms(time["p95"])] for stage, time in times.items()]
    return Table(["ms per target", "median", "95 %"], rows)


def timing_words(summary: Mapping[str, Any]) -> str:
    """How the times were measured, in a line; empty where the summary does not say."""
    timing = summary.get("timing")
    if not timing:
        return ""
    counted = "1 frame" if timing["frames"] == 1 else f"{timing['frames']} frames"
    words = f"Times: measured by this run on {counted}."
    if timing["reused_stages"]:
        reused = ", ".join(timing["reused_stages"])
        words = f"Times: the results of {reused} were reused; measured again on {counted}."
    first = timing["first_use_seconds"]
    if first is not None:
        words += f" The first frame, with loading and compiling, took {first:.1f} s (not included)."
    return words


def total_table(summary: Mapping[str, Any]) -> Table:
    """How many targets were correct and how many were lost by which cause, and their shares."""
    counts = summary["waterfall"]
    if "total" in counts:
        counts = counts["total"]
    total = max(summary["targets"], 1)
    rows = [[_words(name), str(count), _share(count / total)] for name, count in counts.items()]
    return Table(["targets ended as", "number", "share"], rows)


def waterfall_tables(summary: Mapping[str, Any]) -> list[Table]:
    """Lost targets by cause, a row an object and a row a class of the visible fraction.

    Causes that lost none are left out. Empty for runs of before there were causes.
    """
    waterfall = summary["waterfall"]
    if "total" not in waterfall:
        return []
    total = waterfall["total"]
    causes = [name for name, count in total.items() if count and name != CORRECT]
    header = ["targets", CORRECT, *map(_words, causes)]
    tables = []
    for panel, title in PANELS.items():
        rows = [
            [name, str(sum(counts.values())), *(str(counts[each]) for each in (CORRECT, *causes))]
            for name, counts in {**waterfall[panel], "all": total}.items()
        ]
        tables.append(Table([title, *header], rows))
    return tables


def votes_table(summary: Mapping[str, Any]) -> Table:
    """Number of votes for one object in one frame, and the share near the truth (good).

    Of all votes, of their weight, and of those cast by patches on the object itself.

    Empty for runs of before votes were kept.
    """
    votes = summary.get("votes", {"per_object": {}})
    groups = {**votes["per_object"], "all": votes["total"]} if "total" in votes else {}
    rows = [
        [name, _ms(each["votes"]), *(_share(each[key]) for key in VOTE_SHARES)]
        for name, each in groups.items()
    ]
    return Table(["votes", "number", *VOTE_SHARES.values()], rows)


def runs_table(summaries: Mapping[str, Mapping[str, Any]]) -> Table:
    """One line a run: recalls over its targets and the median time of one."""
    rows = [
        [
            name,
            str(summary["targets"]),
            *(_share(summary["metrics"][key]["recall"]) for key in METRICS),
            _ms(summary["timing_ms"].get("total", {}).get("median")),
        ]
        for name, summary in summaries.items()
    ]
    return Table(["run", "targets", *METRICS.values(), "ms"], rows)


def interval_words(ends: Sequence[float]) -> str:
    """A 95 % interval of a recall."""
    return "-".join(_share(end) for end in ends)


def _words(name: str) -> str:
    return name.replace("_", " ")


def _share(value: float | None) -> str:
    return "" if value is None else f"{value:.3f}"


def _ms(value: float | None) -> str:
    return "" if value is None else f"{value:.0f}" if value >= 10 else f"{value:.1f}"
