"""What parts whose model has no colours look like in a frame: colours, print, how plain they are.

Parts of one kind look alike, whatever their colour is. An answer in the colours of others that are
probably right is more likely right, one in the colours of the bin less. Most parts are of one
material: within their outline, the image has edges only where the model has some. Cartons are
printed; the surest answers tell whether the parts of a frame are. If so, right answers show the
same print at the same places of their surface.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import cv2
import numpy as np
from jaxtyping import Bool, Float, Float32, Int8, Int64, UInt8

from hlp.arrays import Flags, Points, Pose, Rgb, Rows, Values
from hlp.geometry import project, transform
from hlp.image_edges import LOGARITHMS, NO_EDGE
from hlp.kernels import compiled_ahead
from hlp.records import ObjectModel
from hlp.refinement.score_model import probabilities
from hlp.refinement.verification import Observation, Verifier
from hlp.rendering.surface import sample_surface

_SIZES = (6, 12, 12)  # classes of lightness, and of both axes of colour
_WIDTHS = np.array([43, 9, 9])  # of a class
_LOWEST = np.array([0, 74, 74])  # of the first class; what lies outside counts as at the border
# Of each value of a channel, what it adds to the number of the class.
_CLASSES = np.clip((np.arange(256)[:, None] - _LOWEST) // _WIDTHS, 0, np.array(_SIZES) - 1)
_CLASSES = (_CLASSES * np.array([_SIZES[1] * _SIZES[2], _SIZES[2], 1])).T.copy()
_BLUR = 0.7  # classes: neighbours are much the same colour
_BACKGROUND = 0.3  # weight of the image's colours, in instances: parts have other sides, too (D)
_RAREST = 1e-5
_COLOR = 0.7  # of the colours' log-likelihood ratio: neighbouring pixels tell the same (D)
_SAMPLES = 256  # of the surface, at which print is compared
_BLURRED = 0.02  # of the diameter: poses are no more exact
_SAME_SURFACE = 0.005  # m between a sample and what is drawn at its pixel
# From logarithms of red, green and blue to brightness, half of it as light varies, and chroma.
_OPPONENT = np.array([[0.5, 0.5, 0.5], [1, -1, 0], [1, 1, -2]], np.float32)
_OPPONENT /= np.sqrt(np.array([[3], [2], [6]], np.float32))
_LIMIT = 0.6  # of a difference: highlights and labels are larger
_NOISE = 0.02  # mean squared difference that light alone makes
_TYPICAL = 150  # pixels that tell which colours the frame has
_COMMON = 0.12  # share of the samples that two answers must both show to be compared
_ALIKE, _STEEPNESS = 0.4, 8.0  # of the log-likelihood ratio in the differences' ratio (D)
_RANGE = -4.0, 3.0  # of it
_LEAST = 0.05  # probability of answers whose print others are compared with
_UNSEEN = 0.1  # weight of print that no answer shows, in instances
_MOST = 2.5  # evidence of print
_ROUNDS = 3  # in which answers tell each other which are right
_EVERY = 4  # px: of the pixels by which the places of answers are told apart
_SAME_PLACE = 0.2  # share of the smaller one's pixels
_BORDER = 4  # px: nearer to edges of the model, edges of the image are expected
_CREASE = 0.006  # m: second difference of depth at an edge of the model (D)
_NEAR = 1  # px from an edge
_LEAST_PIXELS = 30
_PLAIN = 0.8  # probability that a part without colours in its model is of one material (D)
_UNSURE = 1.5  # of the logit of scores by which that is judged (D)
BEST_OF_MANY = -0.3
"""Added to the logit before anything is seen of colours: templates find many poses, and of the best
of many more are wrong than of the few that scores were fitted to (D)."""

Shares = Float[np.ndarray, "864"]
"""Share of the pixels in each class of colour."""


class PartAppearance(NamedTuple):
    """What an image shows of a part at a pose.

    The `shares` of colours within its outline, and that of pixels near an edge that the model
    lacks, the `clutter`: nan where too few pixels are far from the model's own edges. `covered` are
    the pixels that agree in depth, every fourth along both axes. `print` are the colours at the
    samples of the surface, nan where they are not seen, and `unlike` their mean squared difference
    to the frame's colours.
    """

    shares: Shares
    clutter: float
    covered: Bool[np.ndarray, "c"]
    print: Float32[np.ndarray, "m 3"]
    unlike: Float32[np.ndarray, "m"]


@dataclass(frozen=True)
class FrameColors:
    """What all parts of a kind in an image are compared with.

    The class of colour (in CIE L*a*b*) of each pixel, the `shares` of all classes, and edges; the
    image `blurred` as much as poses are inexact, and colours `typical` of it; `samples` (m) of the
    part's surface, and for each of its symmetries the rows that are `equal` to them.
    """

    classes: Int64[np.ndarray, "h w"]
    shares: Shares
    near_edge: Bool[np.ndarray, "h w"]
    blurred: Rgb
    typical: Float32[np.ndarray, "t 3"]
    samples: Points
    equal: Int64[np.ndarray, "k m"]

    @classmethod
    def of(
        cls, rgb: Rgb, edges: Int8[np.ndarray, "h w"], model: ObjectModel, size: float
    ) -> "FrameColors":
        """Those of an image and its `edges`; the part's diameter is about `size` (px) in it."""
        lab = cv2.cvtColor(np.ascontiguousarray(rgb), cv2.COLOR_RGB2LAB)
        first, second, third = (own[lab[..., i]] for i, own in enumerate(_CLASSES))
        classes = first + second + third
        near_edge = _near(edges != NO_EDGE, _NEAR)
        blurred = np.asarray(cv2.GaussianBlur(rgb, (0, 0), max(_BLURRED * size, 0.3)))
        pixels = blurred.reshape(-1, 3)
        typical = _opponent(pixels[np.arange(_TYPICAL) * len(pixels) // _TYPICAL])
        samples = sample_surface(model.proxy, _SAMPLES).points
        equal = np.stack([_nearest(transform(turn, samples), samples) for turn in model.symmetries])
        return cls(classes, _shares(classes), near_edge, blurred, typical, samples, equal)

    def at(self, verifier: Verifier, observation: Observation, pose: Pose) -> PartAppearance:
        """The look of the pixels that agree in depth with a pose of the verifier's object."""
        drawn = verifier.depth_of(observation, pose)
        agreeing = drawn.explains(observation.depth, verifier.tau_depth)
        own_edges = np.abs(cv2.Laplacian(drawn.depth, cv2.CV_32F)) > _CREASE
        inside = agreeing & ~_near(own_edges | (drawn.depth == 0.0), _BORDER)
        enough = np.count_nonzero(inside) >= _LEAST_PIXELS
        clutter = float(drawn.part(self.near_edge)[inside].mean()) if enough else np.nan

        points = transform(pose, self.samples)
        pixels = np.floor(project(points, observation.camera_matrix) + 0.5).astype(int)
        first, size = (drawn.columns.start, drawn.rows.start), agreeing.shape[::-1]
        x, y = np.clip(pixels - first, 0, np.array(size) - 1).T
        seen = agreeing[y, x] & (pixels - first == np.column_stack([x, y])).all(axis=1)
        seen &= np.abs(drawn.depth[y, x] - points[:, 2]) < _SAME_SURFACE
        colors = _opponent(drawn.part(self.blurred)[y[seen], x[seen]])
        print_ = np.full((len(seen), 3), np.nan, dtype=np.float32)
        unlike, print_[seen] = print_[:, 0].copy(), colors
        apart = np.square(colors[:, None] - self.typical).sum(axis=-1)
        unlike[seen] = np.minimum(apart, np.float32(_LIMIT**2)).mean(axis=1)
        covered = np.zeros(observation.depth.shape, dtype=bool)
        drawn.part(covered)[:] = agreeing
        shares, covered = _shares(drawn.part(self.classes)[agreeing]), covered[::_EVERY, ::_EVERY]
        return PartAppearance(shares, clutter, covered.ravel(), print_, unlike)


def _nearest(points: Points, others: Points) -> Rows:
    """The nearest of other points to each."""
    return np.asarray(np.linalg.norm(points[:, None] - others, axis=-1).argmin(axis=1))


def _near(mask: Bool[np.ndarray, "h w"], distance: int) -> Bool[np.ndarray, "h w"]:
    """Pixels up to a distance (px, along both axes) from those of a mask."""
    window = np.ones((2 * distance + 1, 2 * distance + 1), np.uint8)
    return np.asarray(cv2.dilate(mask.view(np.uint8), window) > 0)


def _shares(classes: Int64[np.ndarray, "n"]) -> Shares:
    """How often each class is among pixels; those next to it count in part."""
    shares = np.bincount(classes.ravel(), minlength=int(np.prod(_SIZES))).reshape(_SIZES)
    for size in _SIZES:  # each axis becomes the last in turn; SciPy need not be installed
        apart = np.subtract.outer(np.arange(size), np.arange(size))
        shares = np.tensordot(shares, np.exp(-0.5 * (apart / _BLUR) ** 2), (0, 0))
    return np.asarray(shares.ravel() / max(float(shares.sum()), 1.0))


def _opponent(colors: UInt8[np.ndarray, "n 3"]) -> Float32[np.ndarray, "n 3"]:
    """Brightness and two axes of chroma of colours, as logarithms."""
    return np.asarray(LOGARITHMS[colors] @ _OPPONENT.T)


def appearance_evidence(
    seen: Sequence[PartAppearance], logits: Values, sure: Flags, frame: FrameColors
) -> Values:
    """Log-likelihood ratio of right against wrong that the look of each answer tells.

    `logits` are those of the answers' scores, `sure` ones tell whether the parts are printed.
    """
    clutter = np.array([answer.clutter for answer in seen])
    evidence, printed = plain_evidence(clutter, logits, sure)
    covered = np.array([answer.covered for answer in seen])
    covered = covered[:, covered.any(axis=0)].astype(np.float32)
    area = covered.sum(axis=1)
    same = covered @ covered.T > _SAME_PLACE * np.minimum(area[:, None], area)
    np.fill_diagonal(same, True)
    logits = logits + evidence
    colors = color_evidence(np.stack([a.shares for a in seen]), logits, same, frame.shares)
    print_ = print_evidence(seen, logits, same, frame.equal)
    return np.asarray(evidence + colors + printed * print_)


def color_evidence(
    shares: Float[np.ndarray, "n 864"],
    logits: Values,
    same: Bool[np.ndarray, "n n"],
    background: Shares,
) -> Values:
    """Log-likelihood ratio of each answer's colours: those of the part against the image's.

    The colours of the part are those of the answers at other places, by the probability of their
    `logits`: no answer speaks for itself, or for what is at the `same` place. Which are probable
    changes by what they tell of each other, so many doubtful ones that look alike outweigh a surer
    one that looks like none.
    """
    evidence = np.zeros(len(logits))
    for _ in range(_ROUNDS):
        others = _weights_of_others(logits + evidence, same)
        part = others.T @ shares + _BACKGROUND * background
        part /= others.sum(axis=0)[:, None] + _BACKGROUND
        ratio = np.log((part + _RAREST) / (background + _RAREST))
        evidence = _COLOR * (shares * ratio).sum(axis=1)
    return evidence


def print_evidence(
    seen: Sequence[PartAppearance],
    logits: Values,
    same: Bool[np.ndarray, "n n"],
    equal: Int64[np.ndarray, "k m"],
) -> Values:
    """Log-likelihood ratio of each answer's print, under the symmetry with which it fits best.

    It is compared with that of answers at other places, sample by sample, as `color_evidence` does
    with colours anywhere. 0 where too little of the same places is seen.
    """
    shown = np.flatnonzero(probabilities(logits) >= _LEAST)
    prints, unlike = np.stack([a.print for a in seen]), np.stack([a.unlike for a in seen])
    constants = _LIMIT**2, _COMMON, _NOISE, _ALIKE
    ratios = _difference_ratios(prints, unlike, shown, equal, *constants)
    alike = np.exp(np.clip(_STEEPNESS * (_ALIKE - ratios), *_RANGE))
    alike[np.isnan(ratios)] = 1.0
    evidence = np.zeros(len(logits))
    for _ in range(_ROUNDS):
        others = _weights_of_others(logits + evidence, same)[shown]
        ratio = (_UNSEEN + (others * alike).sum(axis=0)) / (_UNSEEN + others.sum(axis=0))
        evidence = np.clip(np.log(ratio), -_MOST, _MOST)
    return evidence


def _weights_of_others(logits: Values, same: Bool[np.ndarray, "n n"]) -> Float[np.ndarray, "n n"]:
    """Weight (first axis) of each for those elsewhere: its probability, at most 1 at a place."""
    right = probabilities(logits)
    weights = right * (same * right).max(axis=1) / np.maximum(same @ right, 1e-9)
    return np.where(same, 0.0, weights[:, None])


@compiled_ahead()
def _difference_ratios(
    colors: Float32[np.ndarray, "n m 3"],
    unlike: Float32[np.ndarray, "n m"],
    shown: Int64[np.ndarray, "s"],
    equal: Int64[np.ndarray, "k m"],
    limit: float,
    common: float,
    noise: float,
    neutral: float,
) -> Float[np.ndarray, "s n"]:
    """Squared difference of each answer's colours to the shown ones' over that to the frame's.

    That of the symmetry with which it is least; nan if both show too few of the samples (`common`).
    """
    count, samples = colors.shape[:2]
    ratios = np.full((len(shown), count), np.nan)
    for n in range(count):
        rows = np.flatnonzero(~np.isnan(colors[n, :, 0]))
        for s in range(len(shown)):
            other = colors[shown[s]]
            for k in range(len(equal)):
                found, total, both = 0.0, 0.0, 0
                for m in rows:
                    place = equal[k, m]
                    if np.isnan(other[place, 0]):
                        continue
                    squared = 0.0
                    for c in range(3):
                        squared += (colors[n, m, c] - other[place, c]) ** 2
                    found += min(squared, limit)
                    total += unlike[n, m]
                    both += 1
                ratio = (found + neutral * noise * both) / (total + noise * both + 1e-9)
                if both >= common * samples and not ratios[s, n] <= ratio:
                    ratios[s, n] = ratio
    return ratios


def plain_evidence(clutter: Values, logits: Values, sure: Flags) -> tuple[Values, float]:
    """Log-likelihood ratio of right against wrong that each clutter tells, and whether printed.

    Much if the part is of one material. If it is printed, only where edges are so dense that an
    outline finds some anywhere. How likely either is follows from the `sure` answers and their
    scores' `logits`; the second value is the probability that the parts are printed.
    """
    # Measured: .03 to .25 within right outlines of plain parts, .25 to .9 within wrong ones; .2 to
    # .7 within cartons, .75 to 1 where parts were taken for a table full of things (D).
    seen = np.where(np.isfinite(clutter), clutter, 0.25)
    plain = np.exp(np.clip(2.5 - 10.0 * seen, -4.0, 1.5))
    printed = np.exp(-8.0 * np.maximum(seen - 0.6, 0.0))
    right = probabilities(logits[sure] - _UNSURE)
    likelihoods = [np.prod(right * ratio[sure] + 1.0 - right) for ratio in (plain, printed)]
    weights = np.array([_PLAIN, 1.0 - _PLAIN]) * likelihoods
    weights /= weights.sum()
    return np.log(weights @ np.stack([plain, printed])), float(weights[1])
