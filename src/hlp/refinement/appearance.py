"""What parts whose model has no colours look like in a frame: their colours, how plain they are.

Parts of one kind look alike, whatever their colour is. An answer in the colours of the surest ones
is more likely right, one in the colours of the bin less. Most parts are of one material: within
their outline, the image has edges only where the model has some. Cartons are printed; the surest
answers tell whether the parts of a frame are.
"""

from dataclasses import dataclass
from typing import NamedTuple

import cv2
import numpy as np
from jaxtyping import Bool, Float, Int64

from hlp.arrays import Flags, Pose, Rgb, Values
from hlp.image_edges import NO_EDGE, color_edges
from hlp.refinement.verification import Observation, Verifier

_SIZES = (6, 12, 12)  # classes of lightness, and of both axes of colour
_WIDTHS = np.array([43, 9, 9])  # of a class
_LOWEST = np.array([0, 74, 74])  # of the first class; what lies outside counts as at the border
_BLUR = 0.7  # classes: neighbours are much the same colour
_BACKGROUND = 0.3  # weight of the image's colours, in instances: parts have other sides, too (D)
_RAREST = 1e-5
_BORDER = 4  # px: nearer to edges of the model, edges of the image are expected
_CREASE = 0.006  # m: second difference of depth at an edge of the model (D)
_NEAR = 1  # px from an edge
_LEAST_PIXELS = 30
_PLAIN = 0.8  # probability that a part without colours in its model is of one material (D)
_UNSURE = 1.5  # of the logit of scores by which that is judged (D)
_COLOR = 0.7  # of the colours' log-likelihood ratio: neighbouring pixels tell the same (D)
BEST_OF_MANY = -0.3
"""Added to the logit before anything is seen of colours: templates find many poses, and of the best
of many more are wrong than of the few on which scores are calibrated (D)."""

Shares = Float[np.ndarray, "864"]
"""Share of the pixels in each class of colour."""


class PartAppearance(NamedTuple):
    """Within an outline: the `shares` of colours, and of pixels near an edge that the model lacks.

    `clutter` is nan where too few pixels are far from the model's own edges.
    """

    shares: Shares
    clutter: float


@dataclass(frozen=True)
class FrameColors:
    """The class of colour (in CIE L*a*b*) of each pixel, the `shares` of all classes, and edges."""

    classes: Int64[np.ndarray, "h w"]
    shares: Shares
    near_edge: Bool[np.ndarray, "h w"]

    @classmethod
    def of(cls, rgb: Rgb) -> "FrameColors":
        """Those of an image."""
        lab = cv2.cvtColor(np.ascontiguousarray(rgb), cv2.COLOR_RGB2LAB).astype(np.int64)
        places = np.clip((lab - _LOWEST) // _WIDTHS, 0, np.array(_SIZES) - 1)
        classes = np.ravel_multi_index(tuple(np.moveaxis(places, -1, 0)), _SIZES)
        return cls(classes, _shares(classes), _near(color_edges(rgb) != NO_EDGE, _NEAR))

    def at(
        self, verifier: Verifier, observation: Observation, pose_cam_obj: Pose
    ) -> PartAppearance:
        """The look of the pixels that agree in depth with a pose of the verifier's object."""
        agreeing, rendered = verifier.explained(observation, pose_cam_obj)
        own_edges = (rendered == 0.0) | (np.abs(cv2.Laplacian(rendered, cv2.CV_32F)) > _CREASE)
        inside = agreeing & ~_near(own_edges, _BORDER)
        enough = np.count_nonzero(inside) >= _LEAST_PIXELS
        clutter = float(self.near_edge[inside].mean()) if enough else np.nan
        return PartAppearance(_shares(self.classes[agreeing]), clutter)


def _near(mask: Bool[np.ndarray, "h w"], distance: int) -> Bool[np.ndarray, "h w"]:
    """Pixels up to a distance (px, along both axes) from those of a mask."""
    window = np.ones((2 * distance + 1, 2 * distance + 1), np.uint8)
    return np.asarray(cv2.dilate(mask.view(np.uint8), window) > 0)


def _shares(classes: Int64[np.ndarray, "n"]) -> Shares:
    """How often each class is among pixels; those next to it count in part."""
    from scipy.ndimage import gaussian_filter  # heavy, and only bins with such parts need it

    count = np.bincount(classes.ravel(), minlength=int(np.prod(_SIZES))).astype(np.float64)
    shares = gaussian_filter(count.reshape(_SIZES), _BLUR, mode="constant").ravel()
    return np.asarray(shares / max(float(shares.sum()), 1.0))


def color_evidence(
    shares: Float[np.ndarray, "n 864"], weights: Values, background: Shares
) -> Values:
    """Log-likelihood ratio of each answer's colours: those of the part against the image's.

    The colours of the part are those of the answers, by their `weights`. An answer does not speak
    for itself: it is compared with the others. 0 where no other one has a weight.
    """
    total = weights @ shares
    part = total - weights[:, None] * shares + _BACKGROUND * background
    part /= (weights.sum() - weights + _BACKGROUND)[:, None]
    ratio = np.log((part + _RAREST) / (background + _RAREST))
    return np.asarray(_COLOR * (shares * ratio).sum(axis=1))


def plain_evidence(clutter: Values, logits: Values, sure: Flags) -> Values:
    """Log-likelihood ratio of right against wrong that each answer's clutter tells.

    Much if the part is of one material. If it is printed, only where edges are so dense that an
    outline finds some anywhere. How likely either is follows from the `sure` answers and their
    scores' `logits`.
    """
    # Measured: .03 to .25 within right outlines of plain parts, .25 to .9 within wrong ones; .2 to
    # .7 within cartons, .75 to 1 where parts were taken for a table full of things (D).
    seen = np.where(np.isfinite(clutter), clutter, 0.25)
    plain = np.exp(np.clip(2.5 - 10.0 * seen, -4.0, 1.5))
    printed = np.exp(-8.0 * np.maximum(seen - 0.6, 0.0))
    right = 1.0 / (1.0 + np.exp(_UNSURE - logits[sure]))
    likelihoods = [np.prod(right * ratio[sure] + 1.0 - right) for ratio in (plain, printed)]
    weights = np.array([_PLAIN, 1.0 - _PLAIN]) * likelihoods
    return np.asarray(np.log(weights @ np.stack([plain, printed]) / weights.sum()))
