"""The paper's Tables 1 and 2, its numbers beside ours, and both as a figure."""

import textwrap
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from statistics import fmean, pstdev
from typing import TYPE_CHECKING

from scipy.stats import binomtest

from hlp.reporting import paper
from hlp.reporting.results import Result
from hlp.reporting.tables import METRICS, Table, interval_words

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

OBJECTS_NOTE = (
    "Paper: Table 1, LINEMOD's whole sequences (left out where an object is none of LINEMOD's); its"
    f" mean of 15 objects is {paper.AD_MEAN:.3f}, standard deviation {paper.AD_STD:.3f}. Ours: an"
    " object's 95 % interval is Wilson's, that of all targets the bootstrap's over frames."
)
METRICS_NOTE = (
    "Paper, and Brachmann et al. as it quotes them: Table 2, the Occlusion set. Ours: recall over"
    " all targets, the bootstrap's 95 % interval over frames."
)
_SPREAD = 0.15
_SHADES = ("black", "0.6")


@dataclass(frozen=True)
class Source:
    """Where a column of recalls is from; None: it says nothing of that row.

    `intervals` (95 %) is empty for others' numbers, which come without.
    """

    label: str
    recalls: list[float | None]
    intervals: list[tuple[float, float] | None]

    @property
    def is_ours(self) -> bool:
        """Whether we measured it."""
        return bool(self.intervals)


Runs = Mapping[str, Result]


def objects_of(runs: Runs) -> list[str]:
    """The objects that some run was asked for, in their order."""
    return list(dict.fromkeys(name for run in runs.values() for name in run.summary["per_object"]))


def object_sources(runs: Runs) -> list[Source]:
    """Table 1: AD recall per object, the paper's first if all objects are LINEMOD's.

    `runs` by what people call them.
    """
    names, known = objects_of(runs), paper.AD_BY_OBJECT
    linemod = all(name in known for name in names)
    sources = [Source("paper", [known[name] for name in names], [])] if linemod else []
    for label, run in runs.items():
        scores = [run.summary["per_object"].get(name) for name in names]
        recalls = [each and each["add"]["recall"] for each in scores]
        ends = [each and wilson(each["add"]["recall"], each["targets"]) for each in scores]
        sources.append(Source(label, recalls, ends))
    return sources


def metric_sources(runs: Runs) -> list[Source]:
    """Table 2: recall over all targets by each metric, the paper's first."""
    sources = [
        Source("paper", [paper.OCCLUSION[key] for key in METRICS], []),
        Source("Brachmann et al.", [paper.OCCLUSION_BRACHMANN[key] for key in METRICS], []),
    ]
    for label, run in runs.items():
        scores = [run.summary["metrics"][key] for key in METRICS]
        ends = [(each["ci95"][0], each["ci95"][1]) for each in scores]
        sources.append(Source(label, [each["recall"] for each in scores], [*ends]))
    return sources


def wilson(recall: float, targets: int) -> tuple[float, float]:
    """Wilson's 95 % interval of a recall over independent targets (Wilson 1927)."""
    ends = binomtest(round(recall * targets), targets).proportion_ci(0.95, method="wilson")
    return float(ends.low), float(ends.high)


def objects_table(runs: Runs) -> Table:
    """Table 1: a row an object, then mean and standard deviation of the objects, all targets."""
    names, sources = objects_of(runs), object_sources(runs)
    rows = _rows(names, sources)
    rows.append(["mean of objects", *_below(sources, fmean)])
    rows.append(["standard deviation", *_below(sources, pstdev)])
    total = ["all targets", *("" for each in sources if not each.is_ours)]
    for run in runs.values():
        add = run.summary["metrics"]["add"]
        total += [_share(add["recall"]), interval_words(add["ci95"])]
    first = next(iter(runs.values())).summary
    asked = [str(first["per_object"].get(name, {}).get("targets", "")) for name in names]
    counts = [*asked, "", "", str(first["targets"])]
    counted = [[row[0], n, *row[1:]] for row, n in zip([*rows, total], counts, strict=True)]
    return Table(["object", "targets", *_header(sources)], counted)


def metrics_table(runs: Runs) -> Table:
    """Table 2: a row a metric."""
    sources = metric_sources(runs)
    return Table(["recall", *_header(sources)], _rows([*METRICS.values()], sources))


def draw_sources(rows: Sequence[str], sources: Sequence[Source], title: str, note: str) -> "Figure":
    """A point a row and source; ours (round) with their 95 % intervals."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(max(0.6 * len(rows) + 2.0, 6.5), 4.6), layout="constrained")
    ax = figure.subplots()
    for i, source in enumerate(sources):
        shift = _SPREAD * (i - (len(sources) - 1) / 2)
        if source.is_ours:
            _draw_ours(ax, source, shift)
        else:
            places = [place + shift for place in range(len(rows))]
            recalls = [each for each in source.recalls if each is not None]
            ax.plot(places, recalls, "D", color=_SHADES[i], label=source.label)
    ax.set_xticks(range(len(rows)), rows, rotation=30 if len(rows) > 6 else 0)
    ax.set_xlim(-0.6, len(rows) - 0.4)
    ax.set_ylim(0.0, 1.03)
    ax.set_ylabel("recall (ours with 95 % interval)")
    ax.grid(axis="y", alpha=0.3)
    ax.spines[["top", "right"]].set_visible(False)
    figure.legend(loc="outside right upper", frameon=False, fontsize=8)
    ax.set_title(title, fontsize=10)
    figure.supxlabel(textwrap.fill(note, 110), fontsize=7, x=0.01, ha="left")
    return figure


def _draw_ours(ax: "Axes", source: Source, shift: float) -> None:
    found = [
        (place + shift, recall, recall - ends[0], ends[1] - recall)
        for place, (recall, ends) in enumerate(zip(source.recalls, source.intervals, strict=True))
        if recall is not None and ends is not None
    ]
    places, recalls, below, above = zip(*found, strict=True)
    ax.errorbar(places, recalls, (below, above), fmt="o", capsize=3, label=source.label)


def _header(sources: Sequence[Source]) -> list[str]:
    return [cell for each in sources for cell in (each.label, *["95 %"] * each.is_ours)]


def _rows(names: Sequence[str], sources: Sequence[Source]) -> list[list[str]]:
    rows = [[name] for name in names]
    for source in sources:
        for i, row in enumerate(rows):
            row.append(_share(source.recalls[i]))
            if source.is_ours:
                ends = source.intervals[i]
                row.append("" if ends is None else interval_words(ends))
    return rows


def _below(sources: Sequence[Source], statistic: Callable[[Sequence[float]], float]) -> list[str]:
    cells = []
    for source in sources:
        known = [recall for recall in source.recalls if recall is not None]
        cells += [_share(statistic(known)), *[""] * source.is_ours]
    return cells


def _share(value: float | None) -> str:
    return "" if value is None else f"{value:.3f}"
