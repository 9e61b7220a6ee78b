"""`report.html` of a sweep: all arms, what differs between them, and what each gains."""

from collections.abc import Sequence
from pathlib import Path

from hlp.files import PAGE, write_text
from hlp.reporting.figures.trade_off import pareto_front
from hlp.reporting.page.parts import in_base64, render
from hlp.reporting.page.svg import BLUE, GREY, ORANGE, SKY, Chart, ticks
from hlp.reporting.results import Result, read_results
from hlp.reporting.sweep_arms import Sweep, SweepArm, sweep_of, sweep_table, sweep_verdict
from hlp.reporting.sweep_report import NAME as SWEEP_FIGURE
from hlp.reporting.tables.summary_tables import METRIC_LABELS
from hlp.reporting.tables.table import Table, format_share

_WIDTH, _ROW, _LEFT = 520, 24, 170


def write_sweep_page(folder: Path) -> Path:
    """Write `report.html` of a sweep from what lies in its folder; the file.

    Raises DataError for broken files.
    """
    sweep = sweep_of(read_results(folder))
    page = render(
        "sweep.html",
        title=f"sweep of {', '.join(sweep.keys) or 'nothing'} · {folder.absolute().name}",
        verdict=sweep_verdict(sweep),
        arms=sweep_table(sweep),
        best=None if sweep.best is None else list(sweep.arms).index(sweep.best),
        links=[f"{arm.folder.name}/{PAGE}" if arm.result else "" for arm in sweep.arms],
        recalls=recall_bars(sweep),
        differences=difference_bars(sweep),
        times=recall_by_time(sweep),
        objects=objects_by_arm(sweep),
        figures=_figures(folder, sweep),
        command=sweep.command,
    )
    write_text(folder / PAGE, page)
    return folder / PAGE


def _figures(folder: Path, sweep: Sweep) -> dict[str, str]:
    """The SVG files of the sweep, and of the paper's figure that it repeats: base64 by caption."""
    experiments = dict.fromkeys(result.experiment for _, result in sweep.finished)
    captions = {SWEEP_FIGURE: "Arms by what differs", **{name: name for name in experiments}}
    found = {words: folder / f"{name}.svg" for name, words in captions.items()}
    return {words: in_base64(path) for words, path in found.items() if path.is_file()}


def recall_bars(sweep: Sweep) -> str:
    """ADD(-S) recall of each finished arm with its 95 % interval; the reference is marked."""
    found = sweep.finished
    if not found:
        return ""
    chart = _rows([arm for arm, _ in found], (0.0, 1.0))
    chart.axes("ADD(-S) recall, 95 % interval", "", [(i / 5, f"{i / 5:.1f}") for i in range(6)])
    for y, (arm, result) in _places(found):
        recall, (low, high) = result.add["recall"], result.add["ci95"]
        title = f"{arm.label}: {recall:.3f} ({low:.3f}-{high:.3f}), {result.targets} targets"
        color = ORANGE if arm is sweep.reference else SKY
        chart.bar((0, y - 0.32), (recall, y + 0.32), color, title)
        chart.line([(low, y), (high, y)], "#222", 1.5, title=title)
        chart.text((0, y), f"{recall:.3f}", shift=(5, 4))
    return chart.svg()


def difference_bars(sweep: Sweep) -> str:
    """Each arm's ADD(-S) recall minus the reference's, target by target, with its interval."""
    known = [(arm, each) for arm in sweep.arms if (each := sweep.difference(arm)) is not None]
    if not known:
        return ""
    reach = max(0.02, *(abs(end) for _, (_, ends) in known for end in ends)) * 1.15
    chart = _rows([arm for arm, _ in known], (-reach, reach))
    name = "the default" if sweep.is_default else "the first arm"
    chart.axes(f"ADD(-S) recall minus that of {name}, 95 % interval", "", ticks(-reach, reach, 5))
    chart.line([(0, 0), (0, len(known))], GREY, 1)
    for row, (arm, (difference, (low, high))) in enumerate(known):
        y = len(known) - row - 0.5
        title = f"{arm.label}: {difference:+.3f} ({low:+.3f} to {high:+.3f})"
        chart.line([(low, y), (high, y)], BLUE, 2, title=title)
        chart.dot((difference, y), BLUE, 4.5, title)
    return chart.svg()


def recall_by_time(sweep: Sweep) -> str:
    """ADD(-S) recall against the median time of an object, with the Pareto front.

    Empty for fewer than two arms.
    """
    found = sweep.finished
    if len(found) < 2:
        return ""
    longest = 1.25 * max(result.total_ms["median"] for _, result in found)
    lowest = min(result.add["ci95"][0] for _, result in found)
    chart = Chart(_WIDTH, 320, (0.0, longest), (max(0.0, lowest - 0.05), 1.02))
    y_ticks = ticks(max(0.0, lowest - 0.05), 1.0)
    chart.axes("ms for one object in one frame (median)", "ADD(-S) recall",
               ticks(0, longest), y_ticks)  # fmt: skip
    times = [result.total_ms["median"] for _, result in found]
    front = pareto_front(times, [result.add["recall"] for _, result in found])
    steps = [(times[i], found[i][1].add["recall"]) for i in front]
    ends = [*steps[1:], (longest, steps[-1][1])]
    stairs = [p for step, end in zip(steps, ends, strict=True) for p in (step, (end[0], step[1]))]
    chart.line(stairs, GREY, 1, "4 3", "Pareto front")
    for arm, result in found:
        time, (low, high) = result.total_ms["median"], result.add["ci95"]
        color = ORANGE if arm is sweep.reference else BLUE
        title = f"{arm.label}: {result.add['recall']:.3f}, {time:.0f} ms"
        chart.line([(time, low), (time, high)], color, 1.5, title=title)
        chart.dot((time, result.add["recall"]), color, 4.5, title)
        chart.text((time, result.add["recall"]), _short(arm), shift=(7, 4))
    return chart.svg()


def objects_by_arm(sweep: Sweep) -> Table:
    """ADD(-S) recall of each object (rows) in each finished arm (columns)."""
    found = sweep.finished
    names = dict.fromkeys(name for _, result in found for name in result.summary["per_object"])
    rows = []
    for name in names:
        scores = [result.summary["per_object"].get(name) for _, result in found]
        rows.append([name, *(format_share(each and each["add"]["recall"]) for each in scores)])
    return Table([f"{METRIC_LABELS['add']} of", *(_short(arm) for arm, _ in found)], rows)


def _places(
    found: Sequence[tuple[SweepArm, Result]],
) -> list[tuple[float, tuple[SweepArm, Result]]]:
    return [(len(found) - row - 0.5, each) for row, each in enumerate(found)]


def _rows(arms: Sequence[SweepArm], ends: tuple[float, float]) -> Chart:
    """An empty chart with a named row for each arm, the first at the top."""
    chart = Chart(_WIDTH, _ROW * len(arms) + 52, ends, (0.0, float(len(arms))), _LEFT, 24)
    for row, arm in enumerate(arms):
        chart.text((ends[0], len(arms) - row - 0.5), _short(arm), "end", (-6, 4))
    return chart


def _short(arm: SweepArm) -> str:
    """The arm's values, without the name of the key if there is but one."""
    words = ", ".join(arm.values.values()) if len(arm.values) == 1 else arm.label
    return words if len(words) <= 26 else f"{words[:25]}…"
