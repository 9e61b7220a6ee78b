"""Two runs compared target by target: what changed, and whether chance alone would do as much."""

import csv
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.stats import binomtest

from hlp.reporting.mlflow_runs import scores_file
from hlp.reporting.tables import FORMATS, METRICS, Table

VERDICTS = {"add": "add_correct", "5cm5deg": "pose_correct", "iou50": "box_correct"}
"""Column of `scores.csv` that holds each metric's verdict."""

RESAMPLINGS = 10_000
SEED = 0
FLIPS_SHOWN = 40
EXPLAINED = """\
Recall of the second run (B) minus that of the first (A), over the targets that both have, with the
95 % interval of the paired bootstrap over frames. p: McNemar's exact test of the targets that only
one of them has right (two-sided); it takes targets as independent, so trust the interval first."""

Target = tuple[int, int, int]


@dataclass(frozen=True)
class Scored:
    """One row of `scores.csv`: errors in mm and degrees, `inf` where there was no pose."""

    name: str
    visible_fraction: float
    add_mm: float
    rotation_deg: float
    correct: dict[str, bool]


def compare(runs: str, uri: str, layout: str) -> str:
    """`compare_runs` for `[A,B]`, each an output folder or a run's id in the MLflow at `uri`."""
    named = [each.strip() for each in runs.removeprefix("[").removesuffix("]").split(",")]
    if len(named) != 2 or not all(named):
        raise ValueError(f"runs={runs}: name two, as runs=[A,B]")
    first, second = (scores_file(each, uri) for each in named)
    return compare_runs(first, second, (named[0], named[1]), layout)


def compare_runs(first: Path, second: Path, names: tuple[str, str], layout: str) -> str:
    """Tables of the differences between two runs' `scores.csv`, for people.

    Raises FileNotFoundError without a file; ValueError for a broken one, for runs that have no
    target in common and for a `layout` that is not `text` or `markdown`.
    """
    if layout not in FORMATS:
        raise ValueError(f"format={layout}: choose one of {', '.join(FORMATS)}")
    scores = (read_scored(first), read_scored(second))
    shared = sorted(scores[0].keys() & scores[1].keys())
    if not shared:
        raise ValueError(f"{names[0]} and {names[1]} have no target in common")
    alone = [len(each) - len(shared) for each in scores]
    parts = [f"A = {names[0]}\nB = {names[1]}", EXPLAINED]
    if any(alone):
        only = f"left out: {alone[0]} targets that only A has, {alone[1]} that only B has"
        parts.append(f"{len(shared)} targets in common; {only}")
    pairs = [(target, scores[0][target], scores[1][target]) for target in shared]
    for metric, shown in METRICS.items():
        parts.append(f"{shown}\n\n{FORMATS[layout](differences_table(pairs, metric))}")
    flips = flips_table(pairs)
    if flips.rows:
        few = Table(flips.header, flips.rows[:FLIPS_SHOWN])
        left = len(flips.rows) - len(few.rows)
        more = f"\n… and {left} more" if left else ""
        parts.append(f"Flipped by AD: {len(flips.rows)}\n\n{FORMATS[layout](few)}{more}")
    else:
        parts.append("No target flipped by AD.")
    return "\n\n".join(parts)


Pair = tuple[Target, Scored, Scored]


def differences_table(pairs: Sequence[Pair], metric: str) -> Table:
    """A row an object and one for all: recalls, their difference, who is right alone, p."""
    names = list(dict.fromkeys(each.name for _, each, _ in sorted(pairs, key=lambda p: p[0][2])))
    groups = [(name, [pair for pair in pairs if pair[1].name == name]) for name in names]
    if len(groups) > 1:
        groups.append(("all targets", list(pairs)))
    rows = []
    for name, group in groups:
        first = np.array([each.correct[metric] for _, each, _ in group])
        second = np.array([each.correct[metric] for _, _, each in group])
        frames = np.unique([target[:2] for target, _, _ in group], axis=0, return_inverse=True)[1]
        low, high = difference_interval(first, second, frames, RESAMPLINGS, SEED)
        lost, gained = int((first & ~second).sum()), int((second & ~first).sum())
        rows.append(
            [
                name,
                str(len(group)),
                f"{first.mean():.3f}",
                f"{second.mean():.3f}",
                f"{second.mean() - first.mean():+.3f}",
                f"{low:+.3f} to {high:+.3f}",
                str(lost),
                str(gained),
                f"{mcnemar_exact(lost, gained):.3g}",
            ]
        )
    return Table(["object", "targets", "A", "B", "B - A", "95 %", "only A", "only B", "p"], rows)


def flips_table(pairs: Sequence[Pair]) -> Table:
    """Targets that are right by AD in one run only; first the lost ones, then the gained."""

    def row(target: Target, before: Scored, after: Scored) -> list[str]:
        return [
            "lost" if before.correct["add"] else "gained",
            f"{target[0]}/{target[1]}",
            after.name,
            f"{after.visible_fraction:.2f}",
            f"{before.add_mm:.1f}",
            f"{after.add_mm:.1f}",
            f"{before.rotation_deg:.1f}",
            f"{after.rotation_deg:.1f}",
        ]

    flipped = [pair for pair in pairs if pair[1].correct["add"] != pair[2].correct["add"]]
    ordered = sorted(flipped, key=lambda pair: (pair[2].correct["add"], pair[0][2], pair[0]))
    header = ["", "scene/image", "object", "visible", "A: AD mm", "B: AD mm", "A: deg", "B: deg"]
    return Table(header, [row(*pair) for pair in ordered])


def difference_interval(
    first: Bool[np.ndarray, "n"],
    second: Bool[np.ndarray, "n"],
    frames: Int[np.ndarray, "n"],
    resamplings: int,
    seed: int,
) -> tuple[float, float]:
    """95 % interval of second's recall minus first's: the percentile bootstrap over frames.

    A frame that is drawn brings all its targets with both verdicts (paired): targets of one frame
    share light and clutter. `frames` holds each target's frame, numbered from 0.
    """
    gains = np.bincount(frames, weights=second.astype(float) - first.astype(float))
    counts = np.bincount(frames)
    drawn = np.random.default_rng(seed).integers(len(counts), size=(resamplings, len(counts)))
    differences: Float[np.ndarray, "r"] = gains[drawn].sum(axis=1) / counts[drawn].sum(axis=1)
    low, high = np.percentile(differences, [2.5, 97.5])
    return float(low), float(high)


def mcnemar_exact(lost: int, gained: int) -> float:
    """Two-sided p of McNemar's exact test: may as many coins have fallen so unevenly?

    `lost` and `gained` targets are right in one run only (McNemar 1947, its exact binomial form).
    """
    flipped = lost + gained
    return 1.0 if flipped == 0 else float(binomtest(lost, flipped, 0.5).pvalue)


def read_scored(path: Path) -> dict[Target, Scored]:
    """`scores.csv` by scene, image and object. Raises ValueError for a broken one."""
    with path.open(encoding="utf-8", newline="") as stream:
        reader = csv.DictReader(stream)
        try:
            return {
                (int(row["scene_id"]), int(row["im_id"]), int(row["obj_id"])): Scored(
                    row["object"],
                    float(row["visible_fraction"]),
                    float(row["add_mm"]),
                    float(row["rotation_deg"]),
                    {metric: bool(int(row[column])) for metric, column in VERDICTS.items()},
                )
                for row in reader
            }
        except (KeyError, TypeError, ValueError) as error:
            raise ValueError(f"{path}, line {reader.line_num}: no score ({error!r})") from error
