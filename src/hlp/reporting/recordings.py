"""`experiment=recordings`: one configuration on several data sets, and what scores are worth."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from hlp.arrays import Values, grouped
from hlp.reporting.comparison import WELL_VISIBLE, recall_of
from hlp.reporting.figures import new_figure
from hlp.reporting.figures.bars import COLORS
from hlp.reporting.results import Result
from hlp.reporting.summary_tables import BOP_RECALLS, CHANCE, run_cells, run_numbers, sure_answers
from hlp.reporting.table import Table, format_share
from hlp.results.recalls import reliability

if TYPE_CHECKING:
    from matplotlib.figure import Figure

DATA, SEED = "data", "seed"
NOTE = (
    "ADD(-S): ADD-S for objects with a symmetry, ADD for the others. AR: mean of BOP's average"
    " recalls VSD, MSSD and MSPD. AP: BOP's average precision, where every object is looked for in"
    " every frame (data.search=all). ECE: expected calibration error of the score; by chance: what"
    " it would be, in the mean, on as many answers if each score was exactly right. Wrong: answers"
    " with a score of at least 0.5 that are wrong, of all with such a score. False alarms: searches"
    " with such an answer where the object is not, of all such searches. ms: median for one object"
    " in one frame."
)
WRONG, ALARMS = "wrong", "false alarms"
_MARKED = (0.5, 0.9)  # scores, on the curves of precision and recall

Repeats = Mapping[str, Sequence[Result]]
"""The results of each data set, which differ by their seeds."""


def repeats_of(results: Sequence[Result], keys: Sequence[str]) -> Repeats:
    """The results by the values of the swept `keys` without the seed."""
    others = [key for key in keys if key != SEED]
    return grouped(results, lambda result: ", ".join(_values(result, others).values()))


def recordings_table(repeats: Repeats, keys: Sequence[str]) -> Table:
    """A row a data set: its size, recalls, BOP's average recalls, time of one object (ms).

    Further keys that were swept have a column each. Of several seeds, their mean and their spread
    (standard deviation) follow.
    """
    bop = [*map(str.upper, BOP_RECALLS)]
    scores = ["ECE", CHANCE, WRONG, ALARMS]
    measured = ["frames", "targets", "ADD(-S)", "95 %", "5cm5deg", "AR", *bop, "AP", *scores, "ms"]
    rows = [row for same in repeats.values() for row in _repeat_rows(same, keys)]
    header = [*keys, *measured]
    return Table(header, [[row.get(name, "") for name in header] for row in rows])


def _values(result: Result, keys: Sequence[str]) -> dict[str, str]:
    """Values of the swept keys; of the data, the name at least."""
    own = {DATA: str(result.config[DATA]["name"]), **result.chosen}
    return {key: own.get(key, "") for key in keys}


def _repeat_rows(repeats: Sequence[Result], keys: Sequence[str]) -> list[dict[str, str]]:
    """A row a result; of several, which differ by their seeds, also their mean and spread."""
    rows = [
        {"frames": str(r.frames), **run_cells(r.summary), **_values(r, keys), **_count_cells([r])}
        for r in repeats
    ]
    if SEED not in keys or len(repeats) < 2:
        return rows
    numbers, data = _numbers_by_seed(repeats), _values(repeats[0], keys)
    for name, found, digits in (("mean", numbers.mean(skipna=False), 3),
                                ("spread", numbers.std(skipna=False), 4)):  # fmt: skip
        cells = {column: format_share(value, digits) for column, value in found.items()}
        rows.append({**cells, **data, SEED: name, "ms": f"{found['ms']:.0f}"})
    rows[-2] |= _count_cells(repeats)
    return rows


def _numbers_by_seed(results: Sequence[Result]) -> pd.DataFrame:
    numbers = [run_numbers(result.summary) for result in results]
    return pd.DataFrame(numbers, [result.seed for result in results], dtype=float)


def _counts(results: Sequence[Result]) -> list[int]:
    """Sure answers (a score of at least a half), wrong ones, searches in vain, false alarms."""
    alarms = [result.summary["false_alarms"] for result in results]
    sure, wrong = np.sum([sure_answers(result.summary) for result in results], axis=0).tolist()
    return [sure, wrong, *(sum(each[name] for each in alarms) for name in ("searched", "alarms"))]


def _count_cells(results: Sequence[Result]) -> dict[str, str]:
    sure, wrong, searched, alarms = _counts(results)
    parts = {WRONG: (wrong, sure), ALARMS: (alarms, searched)}
    return {name: f"{part}/{of}" if of else "" for name, (part, of) in parts.items()}


def recording_figures(repeats: Repeats) -> Table:
    """A row a data set: recalls by seed, and means over them; another for its hidden targets.

    The interval is that of the first seed. Answers and searches are those of all seeds.
    """
    seeds = sorted({result.seed for own in repeats.values() for result in own})
    rows = []
    for data, own in repeats.items():
        numbers, ends = _numbers_by_seed(own), [*map(format_share, own[0].add["ci95"])]
        counts = [*map(str, _counts(own)), f"{numbers['ms'].mean():.0f}"]
        rows.append([data, str(own[0].targets), *_mean_cells(numbers, seeds, ends), *counts])
        hidden = {result.seed: targets for result in own if (targets := result.hidden_targets)}
        if hidden:
            name, count = f"{data} below {WELL_VISIBLE:g} visible", len(hidden[own[0].seed])
            shares = [[recall_of(of, key) for key in ("add", "5cm5deg")] for of in hidden.values()]
            recalls = pd.DataFrame(shares, [*hidden], ["ADD(-S)", "5cm5deg"])
            rows.append([name, str(count), *_mean_cells(recalls, seeds, ["", ""]), *[""] * 5])
    by_seed = [f"add_seed_{seed}" for seed in seeds]
    means = ["add", "add_low", "add_high", "5cm5deg", "ar", "ece", "ece_by_chance"]
    counted = ["sure", "sure_wrong", "searched_in_vain", "false_alarms", "ms"]
    return Table(["data", "targets", *by_seed, *means, *counted], rows)


def _mean_cells(numbers: pd.DataFrame, seeds: Sequence[str], ends: Sequence[str]) -> list[str]:
    by_seed = numbers["ADD(-S)"].reindex(seeds)
    means = numbers.mean(skipna=False).reindex(["ADD(-S)", "5cm5deg", "AR", "ECE", CHANCE])
    add, *others = map(format_share, means)
    return [*map(format_share, by_seed), add, *ends, *others]


def draw_scores(repeats: Repeats) -> "Figure | None":
    """What scores are worth, a line a data set; None if no run has kept its answers.

    Left: precision by recall, down to each score. Right: the share of right answers by score.
    Answers where the object is not count as wrong ones.
    """
    answers = {data: _answers(own) for data, own in repeats.items()}
    answers = {data: found for data, found in answers.items() if len(found[0])}
    if not answers:
        return None
    figure = new_figure(9.0, 4.2)
    left, right = figure.subplots(1, 2)
    right.plot([0, 1], [0, 1], color="0.6", linewidth=1)
    for number, (data, (scores, correct)) in enumerate(answers.items()):
        style = {"color": COLORS[number % len(COLORS)], "linestyle": ("-", "--")[number > 5]}
        targets = sum(result.targets for result in repeats[data])
        counted = np.cumsum(correct)
        recall, precision = counted / targets, counted / (1 + np.arange(len(scores)))
        left.step(recall, precision, where="post", label=data, **style)
        for marked, sign in zip(_MARKED, "ox", strict=True):
            if (last := int((scores >= marked).sum())) > 0:
                left.plot(recall[last - 1], precision[last - 1], sign, color=style["color"])
        _, score, share = reliability(scores, correct > 0.0).T
        right.plot(score, share, marker=".", **style)
    left.set(xlabel="recall: share of the targets", ylabel="precision: share of right answers")
    left.set(xlim=(0, 1.01), ylim=(0, 1.02), title="down to a score of 0.5 (o) and 0.9 (x)")
    right.set(xlabel="score", ylabel="share of right answers", xlim=(0, 1), ylim=(0, 1.02))
    left.legend(fontsize="small")
    return figure


def _answers(results: Sequence[Result]) -> tuple[Values, Values]:
    """Scores of all answers, the highest first, and whether each is right (ADD-S)."""
    found: list[tuple[float, bool]] = []
    for result in results:
        targets = [target.score for target in result.scores.values()]
        found += [(t.score, t.add_s_correct) for t in targets if t.found and np.isfinite(t.score)]
        found += [(score, False) for score in result.summary["false_alarms"]["scores"]]
    table = np.array(sorted(found, reverse=True), dtype=np.float64).reshape(-1, 2)
    return table[:, 0], table[:, 1]
