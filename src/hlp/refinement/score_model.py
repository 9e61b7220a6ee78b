"""The score of a pose: the probability that it is right, by logistic regression on its fit.

A pose is right if its ADD-S is below a tenth of the object's diameter. The weights of an object
are fitted to poses whose truth is known, and are drawn to `PRIOR`, which was fitted to poses of
many objects: a few dozen scenes tell where an object's own scale lies, not all of it. Colours that
contradict the object's lower the score by a fixed rule, which is no part of the fit: rendered
colours agree better than a camera's, so rendered scenes cannot say by how much.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float

from hlp.errors import DataError, MissingFileError
from hlp.files import read_json, write_json
from hlp.refinement.pose_fit import PoseFit
from hlp.settings import Settings, stored_as

MIN_SCORE = 0.5
"""An answer with a lower score is more likely wrong than right: the object was not found."""
_FILE = "score.json"
_AGREEING = 0.6  # correlation of colours; with less, they contradict (D)
_CONTRADICTION = 50.0  # of the logit, for each unit of correlation and of squared contrast (D)
_HIGHEST_CONTRAST = 0.8
_LEAST_VISIBLE = 0.3  # of the object: as in the scenes on which the score is calibrated
_HIGHEST = 0.995  # correlation; sensor noise decides above it


@dataclass(frozen=True)
class ScoreModel:
    """Weights of the logistic regression: score = 1 / (1 + exp(-(bias + cost·c + shape·z - d))).

    c is the verification cost, z the mean Fisher transform artanh(r) of the correlations r of
    relief and slope, d = color times how much the colours contradict. `cost` is at most 0 and
    `shape` at least 0: the score never falls when the fit is better. An object of which less than
    `least_visible` is seen is not found: its score is below `MIN_SCORE`, in proportion.
    """

    bias: float
    cost: float
    shape: float
    color: float = _CONTRADICTION
    least_visible: float = _LEAST_VISIBLE

    def score(self, fit: PoseFit) -> float:
        """The probability that a pose with this fit is right."""
        logit = self.weights() @ np.array([1.0, *_inputs([fit])[0]])
        logit -= self.color * _contradiction(fit)
        score = float(1.0 / (1.0 + np.exp(-np.clip(logit, -50.0, 50.0))))
        if fit.visible_fraction < self.least_visible:
            score = min(score, MIN_SCORE * fit.visible_fraction / self.least_visible)
        return score

    def known_present(self) -> "ScoreModel":
        """The score of an object that is known to be in the image, as BOP's targets are.

        Colours that contradict then say more of the light than of another object, and a small part
        of it is enough.
        """
        more = np.log(PRESENT_SHARE / (1.0 - PRESENT_SHARE))
        more -= np.log(RIGHT_SHARE / (1.0 - RIGHT_SHARE))
        return ScoreModel(self.bias + float(more), self.cost, self.shape, 0.0, 0.0)

    def weights(self) -> Float[np.ndarray, "3"]:
        """Bias, cost and shape, in this order."""
        return np.array([self.bias, self.cost, self.shape])


PRIOR = ScoreModel(bias=2.8, cost=-27.2, shape=3.5)
"""Weights of objects in general: fitted to rendered scenes of nine objects of LINEMOD, YCB and
Tejani et al., as benchmarks/score_prior.py does it, with a bias of 2.4 where half of the answers
were right; 2.8 is for `RIGHT_SHARE`."""
RIGHT_SHARE = 0.6
"""Share of right poses among the answers, before anything is known of their fit: ours (D)."""
PRESENT_SHARE = 0.9
"""The same where the object is known to be in the image: ours (D)."""
SPREAD = ScoreModel(bias=0.5, cost=3.0, shape=0.3)
"""Standard deviations of an object's weights from `PRIOR`."""


def fit_score_model(
    fits: Sequence[PoseFit], right: Bool[np.ndarray, "n"], spread: ScoreModel = SPREAD
) -> ScoreModel:
    """The most probable weights, given poses that are right or not, and their prior.

    Maximum a posteriori with independent normal priors about `PRIOR`, of standard deviations
    `spread`; `cost` and `shape` are bounded by 0. Right poses have `RIGHT_SHARE` of the weight,
    whatever their number: that of the scenes says nothing about where the object will be looked
    for. Without right or without wrong poses it is the prior.
    """
    from scipy.optimize import minimize  # takes as long to import as finding an object

    count = np.array([np.count_nonzero(~right), np.count_nonzero(right)])
    if not count.all():
        return PRIOR
    inputs = np.column_stack([np.ones(len(fits)), _inputs(fits)])
    shares = np.array([1.0 - RIGHT_SHARE, RIGHT_SHARE])
    counted = (len(fits) * shares / count)[right.astype(int)]
    prior, unit = PRIOR.weights(), spread.weights()

    def loss(away: Float[np.ndarray, "3"]) -> tuple[float, Float[np.ndarray, "3"]]:
        logits = inputs @ (prior + away * unit)
        value = counted @ (np.logaddexp(0.0, logits) - logits * right) + 0.5 * away @ away
        wrong = 1.0 / (1.0 + np.exp(-np.clip(logits, -50.0, 50.0))) - right
        return float(value), inputs.T @ (counted * wrong) * unit + away

    # In standard deviations from the prior, where all three weights are of one size.
    bounds = [(None, None), (None, -prior[1] / unit[1]), (-prior[2] / unit[2], None)]
    found = minimize(loss, np.zeros(3), jac=True, method="L-BFGS-B", bounds=bounds)
    bias, cost, shape = prior + found.x * unit
    return ScoreModel(float(bias), min(float(cost), 0.0), max(float(shape), 0.0))


@dataclass(frozen=True)
class _Weights(Settings):
    """What score.json must say."""

    bias: float
    cost: float
    shape: float


def save_score_model(folder: Path, model: ScoreModel) -> None:
    """Write the weights into a folder."""
    write_json(folder / _FILE, {"bias": model.bias, "cost": model.cost, "shape": model.shape})


def load_score_model(folder: Path) -> ScoreModel:
    """Read what `save_score_model` wrote. Raises MissingFileError and DataError naming the file."""
    path = folder / _FILE
    if not path.is_file():
        raise MissingFileError(f"{path} is missing: learn the object again")
    try:
        stated = stored_as(_Weights, read_json(path), str(path))
    except DataError as error:
        raise DataError(f"{error}: it is damaged, learn the object again") from error
    weights = [stated.bias, stated.cost, stated.shape]
    if not np.isfinite(weights).all():
        raise DataError(f"{path} is damaged (not finite): learn the object again")
    return ScoreModel(*weights)


def _inputs(fits: Sequence[PoseFit]) -> Float[np.ndarray, "n 2"]:
    pairs = np.array([(fit.relief, fit.slope) for fit in fits])
    shape = np.arctanh(np.clip(pairs, 0.0, _HIGHEST)).mean(axis=1)
    return np.column_stack([[fit.cost for fit in fits], shape])


def _contradiction(fit: PoseFit) -> float:
    """How much the colours contradict: most where the object is colourful or printed."""
    lacking = max(_AGREEING - fit.color, 0.0)
    return float(lacking * min(fit.contrast, _HIGHEST_CONTRAST) ** 2)
