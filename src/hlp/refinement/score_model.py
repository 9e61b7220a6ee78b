"""The score of a pose: the probability that it is right, by logistic regression on its fit.

A pose is right if its ADD-S is below a tenth of the object's diameter. The weights of an object
are fitted to poses whose truth is known, and are drawn to `PRIOR`, which was fitted to poses of
many objects: a few dozen scenes tell where an object's own scale lies, not all of it.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Bool, Float
from scipy.optimize import minimize

from hlp.errors import DataError, MissingFileError
from hlp.files import read_json, write_json
from hlp.refinement.pose_fit import PoseFit

_FILE = "score.json"
_HIGHEST_RELIEF = 0.995  # sensor noise decides above it


@dataclass(frozen=True)
class ScoreModel:
    """Weights of the logistic regression: score = 1 / (1 + exp(-(bias + cost·c + relief·z))).

    c is the verification cost and z the Fisher transform artanh(r) of the relief's correlation r.
    `cost` is at most 0 and `relief` at least 0: the score never falls when the fit is better.
    """

    bias: float
    cost: float
    relief: float

    def score(self, fit: PoseFit) -> float:
        """The probability that a pose with this fit is right."""
        logit = self._weights() @ np.array([1.0, *_inputs([fit])[0]])
        return float(1.0 / (1.0 + np.exp(-np.clip(logit, -50.0, 50.0))))

    def _weights(self) -> Float[np.ndarray, "3"]:
        return np.array([self.bias, self.cost, self.relief])


PRIOR = ScoreModel(bias=1.0, cost=-20.0, relief=3.0)
"""Weights of an object of which nothing is known but its CAD model."""
_SPREAD = np.array([2.0, 10.0, 1.5])
"""Standard deviations of the weights over objects."""


def fit_score_model(fits: Sequence[PoseFit], right: Bool[np.ndarray, "n"]) -> ScoreModel:
    """The most probable weights, given poses that are right or not, and their prior.

    Maximum a posteriori with independent normal priors, `cost` and `relief` bounded by 0. Without
    poses it is the prior.
    """
    inputs = np.column_stack([np.ones(len(fits)), _inputs(fits)])
    prior = PRIOR._weights()

    def loss(weights: Float[np.ndarray, "3"]) -> tuple[float, Float[np.ndarray, "3"]]:
        logits = inputs @ weights
        away = (weights - prior) / _SPREAD
        value = np.logaddexp(0.0, logits).sum() - logits[right].sum() + 0.5 * away @ away
        slope = inputs.T @ (1.0 / (1.0 + np.exp(-logits)) - right) + away / _SPREAD
        return float(value), slope

    bounds = [(None, None), (None, 0.0), (0.0, None)]
    found = minimize(loss, prior, jac=True, method="L-BFGS-B", bounds=bounds)
    return ScoreModel(*(float(weight) for weight in found.x))


def save_score_model(folder: Path, model: ScoreModel) -> None:
    """Write the weights into a folder."""
    write_json(folder / _FILE, {"bias": model.bias, "cost": model.cost, "relief": model.relief})


def load_score_model(folder: Path) -> ScoreModel:
    """Read what `save_score_model` wrote. Raises MissingFileError and DataError naming the file."""
    path = folder / _FILE
    if not path.is_file():
        raise MissingFileError(f"{path} is missing: learn the object again")
    content: Any = read_json(path)
    try:
        weights = [float(content[name]) for name in ("bias", "cost", "relief")]
    except (KeyError, TypeError, ValueError) as error:
        raise DataError(f"{path} is damaged ({error!r}): learn the object again") from error
    if not np.isfinite(weights).all():
        raise DataError(f"{path} is damaged (not finite): learn the object again")
    return ScoreModel(*weights)


def _inputs(fits: Sequence[PoseFit]) -> Float[np.ndarray, "n 2"]:
    relief = np.clip([fit.relief for fit in fits], 0.0, _HIGHEST_RELIEF)
    return np.column_stack([[fit.cost for fit in fits], np.arctanh(relief)])
