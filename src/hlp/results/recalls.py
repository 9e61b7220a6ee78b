"""Recalls over targets: in `summary.json` of a run, one by one in `targets.csv`, their intervals.

The 95 % intervals, also of differences, are over targets that are not independent.
"""

import math
from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from itertools import count
from pathlib import Path
from typing import Any, Union

import numpy as np
from jaxtyping import Bool, Float, Int

from hlp.errors import DataError
from hlp.files import read_csv, read_json, write_csv
from hlp.records import TargetScore
from hlp.schemas import by_name, record, several
from hlp.settings import Count, NotNegative, Share, WholeNumber, stored_as

Summary = dict[str, Any]

CORRECT = "correct"
"""Stands beside the causes of misses in a waterfall."""
METRICS: dict[str, Callable[[TargetScore], bool]] = {
    "add": lambda score: score.add_correct,
    "5cm5deg": lambda score: score.pose_correct,
    "iou50": lambda score: score.box_correct,
}
"""Name of each metric in `summary.json`, and the verdict of a score that it counts."""

_SHARE, _LONG = Share | None, NotNegative | None
_COUNTS, _MANY = by_name(WholeNumber), several(Share)
INTERVAL = record(recall=Share, ci95=several(float, 2))
"""A recall and its 95 % interval."""
_STATED = record(
    targets=Count,
    metrics=by_name(record(recall=Share, ci95=several(float, 2), mean_object=Share)),
    per_object=by_name(by_name(Union[WholeNumber, INTERVAL])),  # noqa: UP007
    bop=record(ar=_SHARE, vsd=_SHARE, mssd=_SHARE, mspd=_SHARE),
    calibration=record(
        answers=WholeNumber, ece=_SHARE, aurc=_SHARE, reliability=several(several(float, 3))
    ),
    false_alarms=record(
        searched=WholeNumber, alarms=WholeNumber, min_score=Share, rate=_SHARE, scores=_MANY
    ),
    timing=record(
        frames=WholeNumber,
        reused_stages=several(str),
        first_use_seconds=_LONG,
        cpu_ms=_LONG,
        wall_ms=_LONG,
        load=NotNegative,
        cores=Count,
    ),
    timing_ms=by_name(record(median=_LONG, p95=_LONG)),
    waterfall=record(total=_COUNTS, per_object=by_name(_COUNTS), per_visibility=by_name(_COUNTS)),
    votes=record(total=by_name(_LONG), per_object=by_name(by_name(_LONG))),
)
_VOTES = {"votes", "good", "good_weight", "by_object", "good_by_object"}


def read_summary(path: Path) -> Summary:
    """Read `summary.json`. Raises MissingFileError, DataError if it is none of this version."""
    summary: Summary = read_json(path)
    where = f"{path} is not a summary of a run by this version"
    stated = stored_as(_STATED, summary, where)
    counts = (*stated.waterfall.per_object.values(), *stated.waterfall.per_visibility.values())
    for names, keyed in (
        (METRICS.keys(), [stated.metrics]),
        ({"targets", *METRICS}, stated.per_object.values()),
        ({"total", "refinement"}, [stated.timing_ms]),
        ({CORRECT}, [stated.waterfall.total]),
        (stated.waterfall.total.keys(), counts),
        (_VOTES, [stated.votes.total, *stated.votes.per_object.values()]),
    ):
        for each in keyed:
            if missing := names - each.keys():
                raise DataError(f"{where}: it lacks {', '.join(sorted(missing))}")
    for own in stated.per_object.values():
        if any(isinstance(own[name], int) for name in METRICS):
            raise DataError(f"{where}: a recall of an object is but a number")
    return summary


def average_recalls(scores: Sequence[TargetScore]) -> dict[str, float | None]:
    """Mean recalls `vsd`, `mssd` and `mspd` over targets, and `ar`, their mean.

    None where they were not computed for some target: VSD needs the frame's depth image. Source:
    BOP Challenge 2020, Sec. 2.2.
    """
    recalls = {
        name: np.mean([getattr(score, f"{name}_recall") for score in scores])
        for name in ("vsd", "mssd", "mspd")
    }
    means = {"ar": np.mean([*recalls.values()]), **recalls}
    return {name: None if np.isnan(mean) else float(mean) for name, mean in means.items()}


FILE = "targets.csv"
_COLUMNS = ("scene_id", "im_id", "obj_id", "instance", "object")

TargetKey = tuple[int, int, int, int]
"""Scene, image, object, and the instance of the object in the image (from 0)."""
TargetValues = Mapping[str, Mapping[TargetKey, float]]
"""Values by the name of the number, then by target; a target may lack some of them."""


def numbered_targets(targets: Iterable[tuple[int, int, int]]) -> list[TargetKey]:
    """Keys of targets that are named by scene, image and object, in their order.

    Several instances of an object in an image are told apart by that order.
    """
    instances: dict[tuple[int, int, int], Iterator[int]] = defaultdict(count)
    return [(*target, next(instances[target])) for target in targets]


def add_verdicts(scores: Sequence[TargetScore]) -> dict[TargetKey, float]:
    """1 for each target that is right by ADD(-S), 0 for each other."""
    keys = numbered_targets((score.scene_id, score.frame_id, score.object_id) for score in scores)
    return {key: float(score.add_correct) for key, score in zip(keys, scores, strict=True)}


def write_target_values(folder: Path, values: TargetValues, names: Mapping[int, str]) -> None:
    """Write targets.csv: one row per target, one column per number, empty where it has none.

    `names` are the objects' names by id; raises KeyError for an object that has none.
    """
    numbers = values.values()
    keys = sorted({key for by_target in numbers for key in by_target})
    rows = [[*key, names[key[2]], *(column.get(key, "") for column in numbers)] for key in keys]
    write_csv(folder / FILE, [*_COLUMNS, *values], rows)


def read_target_values(folder: Path) -> dict[str, dict[TargetKey, float]]:
    """What `write_target_values` has written; empty if the folder has no such file.

    Raises DataError naming the file, and the line that holds no numbers.
    """
    path = folder / FILE
    if not path.is_file():
        return {}
    rows = read_csv(path, _COLUMNS, more=True)
    names = [name for name in (rows[0] if rows else ()) if name not in _COLUMNS]
    values: dict[str, dict[TargetKey, float]] = {name: {} for name in names}
    for line, row in enumerate(rows, start=2):
        try:
            scene, image, object_id, instance = (int(row[column]) for column in _COLUMNS[:4])
            found = {name: float(row[name]) for name in names if row[name] != ""}
        except ValueError as error:
            raise DataError(f"{path}, line {line}: no target ({error})") from error
        if not all(map(math.isfinite, found.values())):
            raise DataError(f"{path}, line {line}: a value is not finite")
        for name, value in found.items():
            values[name][scene, image, object_id, instance] = value
    return values


BLOCK = 20
"""Frames that are drawn together, at most (D)."""
_BLOCKS = 10  # at least, of which the resamples are made
Values = Bool[np.ndarray, "n"] | Float[np.ndarray, "n"]


def blocks_of(frames: Sequence[tuple[int, int]]) -> Int[np.ndarray, "n"]:
    """The block, numbered from 0, of each of n targets, given its scene and its frame's number.

    A block is `BLOCK` neighbouring frames of a scene, or as many as leave ten blocks in all.
    Neighbouring frames of a video show nearly the same: drawn one by one they would count as more
    than they tell (the block bootstrap of Carlstein 1986). Targets of a single frame are drawn one
    by one: there is nothing else to resample.
    """
    unique, target_frames = np.unique(np.asarray(frames), axis=0, return_inverse=True)
    if len(unique) == 1:
        return np.arange(len(target_frames))
    scenes = unique[:, 0]
    places = np.arange(len(unique)) - np.searchsorted(scenes, scenes)
    size = min(BLOCK, max(len(unique) // _BLOCKS, 1))
    blocks = np.unique(np.stack([scenes, places // size], axis=1), axis=0, return_inverse=True)[1]
    return np.asarray(blocks.ravel()[target_frames.ravel()])


def recall_interval(
    right: Bool[np.ndarray, "n"], blocks: Int[np.ndarray, "n"], resamplings: int, seed: int
) -> tuple[float, float]:
    """95 % interval of the recall over n targets, by the percentile bootstrap over blocks.

    Where every resample is the same, as when all or none are right, it is Wilson's.
    """
    low, high = _bootstrap(right.astype(float), blocks, resamplings, seed)
    return (low, high) if low < high else wilson(low, len(right))


def difference_interval(
    first: Values, second: Values, blocks: Int[np.ndarray, "n"], resamplings: int, seed: int
) -> tuple[float, float]:
    """95 % interval of second's mean minus first's: the percentile bootstrap over blocks.

    Of verdicts, the mean is the recall. Blocks are resampled with all their targets and both values
    of each (paired). Where every resample is the same, as with few targets, it is made of Wilson's
    intervals of what was gained and of what was lost (Newcombe 1998, method 10).
    """
    change = second.astype(float) - first.astype(float)
    low, high = _bootstrap(change, blocks, resamplings, seed)
    if low < high:
        return low, high
    shares = [min(float(np.maximum(sign * change, 0.0).mean()), 1.0) for sign in (1.0, -1.0)]
    gained, lost = (wilson(share, len(change)) for share in shares)
    below = math.hypot(shares[0] - gained[0], lost[1] - shares[1])
    above = math.hypot(gained[1] - shares[0], shares[1] - lost[0])
    return max(low - below, -1.0), min(high + above, 1.0)


def wilson(recall: float, targets: int) -> tuple[float, float]:
    """Wilson's 95 % interval of a recall over independent targets (Wilson 1927)."""
    from scipy.stats import binomtest  # takes half a second to import

    ends = binomtest(round(recall * targets), targets).proportion_ci(0.95, method="wilson")
    return float(ends.low), float(ends.high)


def _bootstrap(
    values: Float[np.ndarray, "n"], blocks: Int[np.ndarray, "n"], resamplings: int, seed: int
) -> tuple[float, float]:
    """Percentile interval of the mean value over targets, whose blocks are resampled."""
    sums, counts = np.bincount(blocks, values), np.bincount(blocks)
    drawn = np.random.default_rng(seed).integers(len(counts), size=(resamplings, len(counts)))
    means: Float[np.ndarray, "r"] = sums[drawn].sum(axis=1) / counts[drawn].sum(axis=1)
    low, high = np.percentile(means, [2.5, 97.5])
    return float(low), float(high)


def reliability(scores: Values, right: Values, bins: int = 10) -> Float[np.ndarray, "b 3"]:
    """Number of answers, mean score and share of right ones of each bin that has any."""
    place = np.minimum((scores * bins).astype(int), bins - 1)
    weights = None, scores, right.astype(float)
    count, total, hits = (np.bincount(place, each, bins) for each in weights)
    used = count > 0
    return np.column_stack([count[used], total[used] / count[used], hits[used] / count[used]])
