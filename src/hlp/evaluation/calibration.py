"""Whether scores mean what they say: expected calibration error, risk and coverage.

An answer is a pose with its score, the probability that it is right. Calibrated scores are right as
often as they say; the risk is the share of wrong ones among those above a threshold, the coverage
how many these are.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
from jaxtyping import Bool, Float

from hlp.records import TargetScore

_BINS = 10


def expected_calibration_error(
    scores: Float[np.ndarray, "n"], right: Bool[np.ndarray, "n"], bins: int = _BINS
) -> float:
    """Mean of |share of right answers − mean score| over bins of equal width, by their answers.

    Guo et al., On Calibration of Modern Neural Networks (ICML 2017), Eq. 3. Raises ValueError
    without answers, or for a score outside [0, 1].
    """
    table = reliability(scores, right, bins)
    gaps = np.abs(table[:, 1] - table[:, 2])
    return float((table[:, 0] * gaps).sum() / table[:, 0].sum())


def reliability(
    scores: Float[np.ndarray, "n"], right: Bool[np.ndarray, "n"], bins: int = _BINS
) -> Float[np.ndarray, "b 3"]:
    """Number of answers, mean score and share of right ones of each bin that has any."""
    if len(scores) == 0:
        raise ValueError("no answer to calibrate")
    if not ((scores >= 0.0) & (scores <= 1.0)).all():
        raise ValueError("scores must be probabilities, from 0 to 1")
    place = np.minimum((scores * bins).astype(int), bins - 1)
    count, total, hits = (
        np.bincount(place, weights, bins) for weights in (None, scores, right.astype(float))
    )
    used = count > 0
    return np.column_stack([count[used], total[used] / count[used], hits[used] / count[used]])


def risk_coverage(
    scores: Float[np.ndarray, "n"], right: Bool[np.ndarray, "n"]
) -> tuple[Float[np.ndarray, "t"], Float[np.ndarray, "t"]]:
    """Coverage and risk at every threshold, the highest score first; equal scores come together.

    Raises ValueError without answers.
    """
    if len(scores) == 0:
        raise ValueError("no answer, no risk")
    order = np.argsort(-scores, kind="stable")
    count = np.arange(1, len(scores) + 1)
    risk = np.cumsum(~right[order]) / count
    last = np.append(np.diff(scores[order]) != 0, True)
    return count[last] / len(scores), risk[last]


def area_under_risk_coverage(scores: Float[np.ndarray, "n"], right: Bool[np.ndarray, "n"]) -> float:
    """Mean risk over all coverages (Geifman et al., ICLR 2019); 0 is best.

    Answers with equal scores are in random order: each has their expected risk. Raises ValueError
    without answers.
    """
    coverage, risk = risk_coverage(scores, right)
    count = np.rint(coverage * len(scores))
    wrong = count * risk
    ends = np.concatenate([[0.0], count]).astype(int)
    lost = np.concatenate([[0.0], wrong])
    steps = np.arange(1, len(scores) + 1)
    # Within equal scores the expected number of wrong answers grows linearly.
    return float((np.interp(steps, ends, lost) / steps).mean())


def summarise_calibration(targets: Sequence[TargetScore]) -> dict[str, Any]:
    """What `summary.json` holds under `calibration`; numbers are None without any answer.

    `reliability` has a row [answers, mean score, share of right ones] for each used bin,
    `risk_coverage` up to 101 points [coverage, risk].
    """
    found = [target for target in targets if target.found and np.isfinite(target.score)]
    if not found:
        return {"answers": 0, "ece": None, "aurc": None, "reliability": [], "risk_coverage": []}
    scores = np.array([target.score for target in found], dtype=np.float64)
    right = np.array([target.add_s_correct for target in found], dtype=bool)
    curve = np.column_stack(risk_coverage(scores, right))
    shown = np.unique(np.linspace(0, len(curve) - 1, 101).round().astype(int))
    return {
        "answers": len(found),
        "ece": expected_calibration_error(scores, right),
        "aurc": area_under_risk_coverage(scores, right),
        "reliability": reliability(scores, right).tolist(),
        "risk_coverage": curve[shown].tolist(),
    }
