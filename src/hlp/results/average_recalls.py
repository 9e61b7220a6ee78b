"""BOP's average recalls over targets."""

from collections.abc import Sequence

import numpy as np

from hlp.records import TargetScore


def average_recalls(scores: Sequence[TargetScore]) -> dict[str, float | None]:
    """Mean recalls `vsd`, `mssd` and `mspd` over targets, and `ar`, their mean.

    None where they were not computed for some target: VSD needs the frame's depth image. Source:
    BOP Challenge 2020, Sec. 2.2.
    """
    recalls = {
        "vsd": _mean_or_none([score.vsd_recall for score in scores]),
        "mssd": _mean_or_none([score.mssd_recall for score in scores]),
        "mspd": _mean_or_none([score.mspd_recall for score in scores]),
    }
    known = [value for value in recalls.values() if value is not None]
    complete = len(known) == len(recalls)
    return {"ar": float(np.mean(known)) if complete else None, **recalls}


def _mean_or_none(values: Sequence[float]) -> float | None:
    mean = float(np.mean(values))
    return None if np.isnan(mean) else mean
