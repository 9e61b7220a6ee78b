"""Tables of one run's summary, with the paper's numbers beside ours, and of several runs."""

from collections.abc import Mapping, Sequence
from statistics import fmean
from typing import Any

from hlp.reporting.table import Table, format_interval, format_share, lay_out, prose
from hlp.results.recalls import CORRECT

METRIC_LABELS = {"add": "ADD(-S)", "5cm5deg": "5cm5deg", "iou50": "IoU.5"}
"""What people call the metrics of `summary.json`."""
VOTE_LABELS = {
    "good": "good",
    "good_weight": "good by weight",
    "by_object": "from the object",
    "good_by_object": "good of these",
}
"""What people call the shares of votes in `summary.json`."""
ADD_CELLS = {"add": "ADD(-S)", "add_low": "low", "add_high": "high"}
"""Columns of figures.csv, and the numbers of `run_numbers` that stand there."""
BOP_RECALLS = ("vsd", "mssd", "mspd")
"""BOP's recalls in `summary.json`, of which `ar` is the mean."""
CHANCE = "by chance"
"""Column of the calibration error that scores would have if each was exactly right."""
RECALL = "Recall: the share of targets (objects to be found in a frame) with a correct pose."


ADD_BY_OBJECT = {
    "ape": 0.970,
    "benchvise": 0.951,
    "bowl": 0.999,
    "cam": 0.953,
    "can": 0.969,
    "cat": 0.979,
    "cup": 0.995,
    "driller": 0.960,
    "duck": 0.977,
    "eggbox": 0.999,
    "glue": 0.830,
    "holepuncher": 0.972,
    "iron": 0.989,
    "lamp": 0.949,
    "phone": 0.903,
}
"""ADD(-S) recall on LINEMOD's whole sequences that the paper prints (Table 1)."""

ADD_MEAN, ADD_STD = 0.960, 0.042
"""Their mean and standard deviation over the objects, as printed."""
MS_PER_FRAME = 800.0
"""The paper's approximate time of one frame on the authors' laptop (i7, GTX 970M)."""


def paper_recalls(names: Sequence[str]) -> list[float]:
    """The paper's recalls of objects; empty unless all are LINEMOD's.

    The duck of another data set is another object.
    """
    linemod = all(name in ADD_BY_OBJECT for name in names)
    return [ADD_BY_OBJECT[name] for name in names] if linemod else []


def run_verdict(summary: Mapping[str, Any]) -> str:
    """How many targets were found, how sure that is, what most misses come from, and the time."""
    add, targets = summary["metrics"]["add"], summary["targets"]
    right = round(add["recall"] * targets)
    low, high = add["ci95"]
    words = f"{right} of {targets} targets have a right pose: ADD(-S) {add['recall']:.3f}"
    words += f" (95 % interval {low:.3f} to {high:.3f})"
    total = summary["waterfall"]["total"].items()
    lost = {name: count for name, count in total if name != CORRECT and count}
    if lost:
        cause = max(lost, key=lambda name: lost[name])
        share = f"{lost[cause]} of {sum(lost.values())}"
        words += f"; most misses come from “{_words(cause)}” ({share})"
    time = summary["timing_ms"]["total"]["median"]
    if time is not None:
        words += f"; an object takes {time:.0f} ms"
    return words + "."


def format_summary(summary: Mapping[str, Any], layout: str = "text") -> str:
    """The three main tables of a run: recall per object, time per stage, causes of misses."""
    tables = (objects_table(summary), time_table(summary), total_table(summary))
    objects, times, total = (lay_out(table, layout) for table in tables)
    said = (RECALL, bop_words(summary), calibration_words(summary), false_alarm_words(summary))
    recall, *words = (prose(sentence, layout) for sentence in (*said, timing_words(summary)))
    return "\n\n".join(filter(None, [recall, objects, *words[:-1], times, words[-1], total]))


def objects_table(summary: Mapping[str, Any]) -> Table:
    """A row an object, then the mean over objects and the recall over targets with its interval.

    The paper's ADD(-S) is a column of its own if all objects are LINEMOD's.
    """
    paper = paper_recalls([*summary["per_object"]])
    metrics = [summary["metrics"][key] for key in METRIC_LABELS]
    rows = []
    for name, scores in summary["per_object"].items():
        recalls = (format_share(scores[key]["recall"]) for key in METRIC_LABELS)
        rows.append([name, str(scores["targets"]), *recalls, format_share(ADD_BY_OBJECT.get(name))])
    targets, of_paper = str(summary["targets"]), format_share(fmean(paper) if paper else None)
    means = (format_share(metric["mean_object"]) for metric in metrics)
    rows.append(["mean of objects", targets, *means, of_paper])
    rows.append(["all targets", targets, *(format_share(m["recall"]) for m in metrics), ""])
    rows.append(["95 % interval", "", *(format_interval(m["ci95"]) for m in metrics), ""])
    table = Table(["object", "targets", *METRIC_LABELS.values(), "paper ADD(-S)"], rows)
    return table if paper else table.without(table.header[-1])


def run_numbers(summary: Mapping[str, Any]) -> dict[str, float | None]:
    """The main numbers of a run by the column they stand in; None where not measured.

    `low` and `high` are the ends of the interval of ADD(-S).
    """
    metrics, times = summary["metrics"], summary["timing_ms"]
    return {
        **{label: metrics[key]["recall"] for key, label in METRIC_LABELS.items()},
        **dict(zip(("low", "high"), metrics["add"]["ci95"], strict=True)),
        **{key.upper(): summary["bop"][key] for key in ("ar", *BOP_RECALLS)},
        "AP": summary.get("detection", {}).get("ap"),
        "ECE": summary["calibration"]["ece"],
        CHANCE: summary["calibration"].get("ece_by_chance"),
        "ms refinement": times["refinement"]["median"],
        "ms": times["total"]["median"],
        "ms 95 %": times["total"]["p95"],
        "CPU ms": summary["timing"]["cpu_ms"],
        "load": summary["timing"]["load"],
    }


def run_cells(summary: Mapping[str, Any]) -> dict[str, str]:
    """The main numbers of a run as they stand in tables, by column; empty where not measured."""
    numbers = run_numbers(summary)
    return {
        **{name: (_ms if "ms" in name else format_share)(n) for name, n in numbers.items()},
        "targets": str(summary["targets"]),
        "95 %": format_interval(summary["metrics"]["add"]["ci95"]),
        "load": f"{numbers['load']:.1f}",
    }


def bop_words(summary: Mapping[str, Any]) -> str:
    """BOP's average recall and the three of which it is the mean; empty if one is missing."""
    recalls = summary["bop"]
    if None in (recalls[key] for key in ("ar", *BOP_RECALLS)):
        return ""
    parts = ", ".join(f"{key.upper()} {recalls[key]:.3f}" for key in BOP_RECALLS)
    return f"BOP's average recall: {recalls['ar']:.3f}, the mean of {parts}."


def calibration_words(summary: Mapping[str, Any]) -> str:
    """Whether the scores mean what they say, in one line; empty if there was no answer."""
    found = summary["calibration"]
    if found["ece"] is None or found["aurc"] is None:
        return ""
    chance = found.get("ece_by_chance")
    exact = "" if chance is None else f" ({chance:.3f} if each was exactly right)"
    return (
        f"Scores of {found['answers']} answers: expected calibration error {found['ece']:.3f}"
        f"{exact}, area under the risk-coverage curve {found['aurc']:.4f} (right: ADD-S)."
    )


def sure_answers(summary: Mapping[str, Any]) -> tuple[int, int]:
    """Number of answers with a score of at least a half, and of the wrong ones among them."""
    bins = [row for row in summary["calibration"]["reliability"] if row[1] >= 0.5]
    return round(sum(row[0] for row in bins)), round(sum(n * (1 - share) for n, _, share in bins))


def false_alarm_words(summary: Mapping[str, Any]) -> str:
    """How often absent objects were said to be there; empty if none was looked for."""
    found = summary["false_alarms"]
    if found["rate"] is None:
        return ""
    return (
        f"False alarms: {found['alarms']} of {found['searched']} searches for an object that is no "
        f"target of the frame scored at least {found['min_score']:g} ({found['rate']:.3f})."
    )


def time_table(summary: Mapping[str, Any]) -> Table:
    """Median and 95th percentile of each stage's time for one object in one frame, total last."""
    times = dict(summary["timing_ms"])
    times["total"] = times.pop("total")
    rows = [[stage, _ms(time["median"]), _ms(time["p95"])] for stage, time in times.items()]
    return Table(["ms per target", "median", "95 %"], rows)


def timing_words(summary: Mapping[str, Any]) -> str:
    """How the times were measured, CPU time beside wall time, and how busy the machine was."""
    timing = summary["timing"]
    counted = "1 frame" if timing["frames"] == 1 else f"{timing['frames']} frames"
    words = [f"Times: measured by this run on {counted}."]
    if timing["reused_stages"]:
        reused = ", ".join(timing["reused_stages"])
        words = [f"Times: the results of {reused} were reused; measured again on {counted}."]
    if (first := timing["first_use_seconds"]) is not None:
        words.append(
            f"The first frame, with loading and compiling, took {first:.1f} s (not included)."
        )
    cpu, wall = timing["cpu_ms"], timing["wall_ms"]
    if cpu is not None and wall is not None:
        words.append(f"Mean of an object: {cpu:.0f} ms of CPU time in {wall:.0f} ms of wall time.")
    load = f"{timing['load']:.1f} on {timing['cores']} cores"
    return " ".join([*words, f"Load of the machine meanwhile: {load}."])


def total_table(summary: Mapping[str, Any]) -> Table:
    """Number and share of correct targets, and of misses by cause."""
    total = max(summary["targets"], 1)
    rows = [
        [_words(name), str(count), format_share(count / total)]
        for name, count in summary["waterfall"]["total"].items()
    ]
    return Table(["targets ended as", "number", "share"], rows)


def waterfall_tables(summary: Mapping[str, Any]) -> list[Table]:
    """Misses by cause: a table by object, and one by class of the visible fraction.

    Causes without a miss are left out.
    """
    waterfall, total = summary["waterfall"], summary["waterfall"]["total"]
    causes = [name for name, count in total.items() if count and name != CORRECT]
    header = ["targets", CORRECT, *map(_words, causes)]
    tables = []
    for group, title in (("per_object", "object"), ("per_visibility", "visible fraction")):
        rows = [
            [name, str(sum(counts.values())), *(str(counts[cause]) for cause in (CORRECT, *causes))]
            for name, counts in {**waterfall[group], "all": total}.items()
        ]
        tables.append(Table([title, *header], rows))
    return tables


def votes_table(summary: Mapping[str, Any]) -> Table:
    """Mean number of votes for one object in one frame, and shares of good ones.

    For their meaning see `evaluation.vote_quality`.
    """
    votes = summary["votes"]
    rows = [
        [name, _ms(quality["votes"]), *(format_share(quality[key]) for key in VOTE_LABELS)]
        for name, quality in {**votes["per_object"], "all": votes["total"]}.items()
    ]
    return Table(["votes", "number", *VOTE_LABELS.values()], rows)


def _words(name: str) -> str:
    return name.replace("_", " ")


def _ms(value: float | None) -> str:
    return "" if value is None else f"{value:.0f}" if value >= 10 else f"{value:.1f}"
