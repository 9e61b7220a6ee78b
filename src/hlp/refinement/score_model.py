"""The score of a pose: the probability that it is right, by logistic regression on its fit.

A pose is right if its ADD-S is below a tenth of the object's diameter. All objects with colours
share their weights, and all without: a few dozen rendered scenes of one object tell them less well.
Rules that are no part of the regression lower a score further where rendered scenes are easier than
real ones: colours that contradict the object's (rendered ones agree better than a camera's), an
image that cuts the object off, few pixels that agree.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from hlp.arrays import Flags, Values
from hlp.refinement.pose_fit import PoseFit

MIN_SCORE = 0.5
"""An answer with a lower score is more likely wrong than right: the object was not found."""
SURE = 0.95
"""With a higher score, an answer of votes needs no second opinion by templates (D)."""
_AGREEING = 0.6  # correlation of colours; with less, they contradict (D)
_CONTRADICTION = 50.0  # of the logit, for each unit of correlation and of squared contrast (D)
_HIGHEST_CONTRAST = 0.8
_COLORFUL = 0.4  # contrast; with less, an object is dull: edges of depth count, too, … (D)
_DULL = 15.0  # of the logit, for each unit of `PoseFit.edge` … (D)
_AT_EDGES = 0.25  # beyond this (D)
_CUT_OFF = 10.0  # of the logit, times the squared fraction beyond the image's border (D)
_NARROW = 8.0  # of the logit, times what the silhouette lacks of the broadest side (D)
_NARROW_ONCE = 3.0  # the same of a single answer for what is known to be there: as fitted (D)
_MANY_PIXELS = 5000.0  # that agree: with fewer, the logit falls by the logarithm of their share (D)
_WORSE = np.array([30.0, 15.0])  # of the logit, times cost and edge beyond those of others … (D)
_USUAL = 0.05  # … and this (D)
_BEST = 0.05  # of the cost: others that cost so much more count e times less (D)
_HIDDEN = 0.15  # of the cost, for the whole object: what is hidden adds so much (D)
_LEVEL = -3.0  # of the logit: what cost and edge of others take from it where all is exact (D)
_FORGIVEN = 2.5  # of the logit, at most: what they take from it beyond that
_ENOUGH = 0.25  # an instance is compared with others whose squared scores sum up to this (D)
_LEAST_VISIBLE = 0.3  # of the object: as in the scenes that weights were fitted to
_HIGHEST = 0.995  # correlation; sensor noise decides above it
_NOISE_MM = 3.0  # of depth; a plane deviation of this size tells half of what a large one tells (D)
_NEUTRAL = 1.2  # Fisher transform between those of right and of wrong poses (D)


@dataclass(frozen=True)
class ScoreModel:
    """Weights of the logistic regression: score = 1 / (1 + exp(-s)).

    s = bias + cost·c + shape·z + edge·e + hidden·h + a - d - 10·b² - 8·n - ln(5000 / p), where c is
    the verification cost, e the distance of the outline to edges of the image, h the hidden
    fraction, a what the appearance tells, d how much the colours contradict, and b the fraction
    beyond the image's border: what it does not show contradicts no pose, so wrong ones gather
    there. n is the share by which the silhouette is smaller than the object's broadest side, p are
    the pixels that agree, at most 5000: what is narrow or small is like many things (`scores` has
    3·n for a single answer known to be there). With colours, n and the logarithm are 0. z is the
    mean Fisher transform artanh(r) of the correlations r of depth and slope, drawn to a neutral
    value where the model itself is nearly a plane, and 0 where too few of its pixels are seen.
    `cost`, `edge` and `hidden` are at most 0 and `shape` at least 0: the score never falls when the
    fit is better. An object of which less than 0.3 is seen is not found: its score is below
    `MIN_SCORE`, in proportion.
    """

    bias: float
    cost: float
    shape: float
    edge: float = 0.0
    hidden: float = 0.0

    def score(self, fit: PoseFit) -> float:
        """The probability that a pose with this fit is right."""
        score = self._probability(fit, _CONTRADICTION * _contradiction(fit))
        if fit.visible_fraction < _LEAST_VISIBLE:
            score = min(score, MIN_SCORE * fit.visible_fraction / _LEAST_VISIBLE)
        return score

    def _probability(self, fit: PoseFit, contradiction: float = 0.0, more: float = 0.0) -> float:
        logit = self.weights(more) @ np.array([1.0, *score_inputs([fit])[0]])
        logit += fit.appearance - contradiction - _CUT_OFF * (1.0 - fit.inside_fraction) ** 2
        logit -= _NARROW * (1.0 - fit.projected_share)
        logit -= np.log(_MANY_PIXELS / np.clip(fit.pixels, 1.0, _MANY_PIXELS))
        return float(probabilities(logit))

    def scores(self, fits: Sequence[PoseFit], known_present: bool = False) -> list[float]:
        """The scores of the answers to all instances of the object in an image.

        They may be known to be there, as BOP's targets are. Colours that contradict then say more
        of the light than of another object, and a small part of it is enough. Of several without
        colours, one is less likely right that fits worse than the surest others: noise and errors
        of the model are the same for all instances in an image. So all are likelier where the
        surest do not fit well: the image is less exact than rendered ones.
        """
        if not known_present:
            return [self.score(fit) for fit in fits]
        if len(fits) < 2:
            return [self._probability(fit, more=PRESENT + once_evidence(fit)) for fit in fits]
        found = np.array([self._probability(fit, more=PRESENT) for fit in fits])
        if not self.colorless:
            return [float(score) for score in found]
        told = PRESENT + self._compared(fits, found)
        return [self._probability(fit, more=more) for fit, more in zip(fits, told, strict=True)]

    def _compared(self, fits: Sequence[PoseFit], scores: Values) -> Values:
        """What is added to the logit of each, for how well the surest others fit."""
        weights, enough = _surest_others(scores)
        others = weights @ _cost_and_edge(fits) / np.maximum(weights.sum(axis=1), _ENOUGH)[:, None]
        level = others @ np.array([self.cost, self.edge])
        forgiven = enough * np.clip(_LEVEL - level, 0.0, _FORGIVEN)
        return np.asarray(forgiven - worse_than_others(fits, scores, _USUAL))

    @property
    def colorless(self) -> bool:
        """Whether it is that of an object without colours, for which edges of the image count."""
        return self.edge < 0.0

    def weights(self, more: float = 0.0) -> Float[np.ndarray, "5"]:
        """Bias and what is added to it, cost, shape, edge and hidden, in this order."""
        return np.array([self.bias + more, self.cost, self.shape, self.edge, self.hidden])


def worse_than_others(fits: Sequence[PoseFit], scores: Values, usual: float) -> Values:
    """What the logit of each falls by if it fits clearly worse than the surest other instances.

    That is by more than what is `usual`, of cost and edge. Those that fit best count most. What
    hidden parts add to the cost is left out.
    """
    own = _cost_and_edge(fits)
    own[:, 0] -= _HIDDEN * (1.0 - np.array([fit.visible_fraction for fit in fits]))
    weights, enough = _surest_others(scores)
    weights = weights * np.exp(-own[:, 0] / _BEST)
    others = weights @ own / np.maximum(weights.sum(axis=1), 1e-12)[:, None]
    return np.asarray(enough * (np.maximum(own - others - usual, 0.0) @ _WORSE))


def _cost_and_edge(fits: Sequence[PoseFit]) -> Float[np.ndarray, "n 2"]:
    return np.array([(fit.cost, fit.edge) for fit in fits])


def _surest_others(scores: Values) -> tuple[Float[np.ndarray, "n n"], Flags]:
    """Weights, for each answer, of the others, and whether those are sure enough."""
    weights = np.tile(scores**2, (len(scores), 1))
    np.fill_diagonal(weights, 0.0)
    return weights, weights.sum(axis=1) >= _ENOUGH


COLORED = ScoreModel(bias=2.8, cost=-27.2, shape=3.5)
"""Fitted to rendered scenes of nine objects of LINEMOD, YCB and Tejani et al., with a bias of 2.4
where half of the answers were right; 2.8 is for `RIGHT_SHARE`."""
COLORLESS = ScoreModel(bias=2.4, cost=-9.5, shape=2.9, edge=-29.0, hidden=-2.4)
"""Fitted to 48 rendered scenes of each of sixteen objects: flat parts, cartons and LINEMOD's
without their colours. The bias was 5.2; it is lower by what false alarms in real frames asked (D).
The scenes were those of commit 337783d0; benchmarks/score_weights.py fits to any data set."""
RIGHT_SHARE = 0.6
"""Share of right poses among the answers, before anything is known of their fit: ours (D)."""
PRESENT_SHARE = 0.9
"""The same where the object is known to be in the image: ours (D)."""


def probabilities(logits: Values) -> Values:
    """The logistic function."""
    return np.asarray(1.0 / (1.0 + np.exp(-np.clip(logits, -50.0, 50.0))))


def logits_of(scores: Values) -> Values:
    """Its inverse, of scores in [0, 1]."""
    scores = np.clip(scores, 1e-9, 1.0 - 1e-9)
    return np.asarray(np.log(scores / (1.0 - scores)))


PRESENT = float(np.subtract(*logits_of(np.array([PRESENT_SHARE, RIGHT_SHARE]))))
"""Added to the logit where the object is known to be in the image."""


def score_model_of(colored: bool) -> ScoreModel:
    """The score of all objects with colours, or of all without."""
    return COLORED if colored else COLORLESS


def dullness_evidence(fit: PoseFit) -> float:
    """What edges of depth tell against a pose of a dull object with colours that may be absent.

    A log-likelihood ratio of at most 0: where colours cannot contradict, missing edges do.
    """
    return _DULL * max(1.0 - fit.contrast / _COLORFUL, 0.0) * min(_AT_EDGES - fit.edge, 0.0)


def once_evidence(fit: PoseFit) -> float:
    """Added to the logit of a single answer, known to be there: narrow sides tell less."""
    return (_NARROW - _NARROW_ONCE) * (1.0 - fit.projected_share)


def score_inputs(fits: Sequence[PoseFit]) -> Float[np.ndarray, "n 4"]:
    """Cost, shape, edge and hidden fraction of each fit."""
    pairs = np.array([(fit.depth_correlation, fit.slope) for fit in fits])
    shape = np.arctanh(np.clip(pairs, 0.0, _HIGHEST)).mean(axis=1)
    # Of a flat side, noise decides the correlations: they count as if they said nothing.
    weight = 1.0 / (
        1.0 + np.square(_NOISE_MM / np.maximum([fit.plane_deviation_mm for fit in fits], 1e-9))
    )
    shape = _NEUTRAL + weight * (shape - _NEUTRAL)
    others = np.array([(fit.edge, 1.0 - fit.visible_fraction) for fit in fits])
    return np.column_stack([[fit.cost for fit in fits], shape, others])


def _contradiction(fit: PoseFit) -> float:
    """How much the colours contradict: most where the object is colourful or printed."""
    lacking = max(_AGREEING - fit.color, 0.0)
    return float(lacking * min(fit.contrast, _HIGHEST_CONTRAST) ** 2)
