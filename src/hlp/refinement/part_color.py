"""The colour of a part whose model has none, learnt in the image from its surest instances.

Parts of one kind look alike, whatever their colour is. An answer in the colours of the surest ones
is more likely right, one in the colours of the bin less.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Float, Int64

from hlp.arrays import Pose, Rgb, Values
from hlp.refinement.verification import Observation, Verifier
from hlp.rendering.rasterizer import render_depth

_SIZES = (6, 12, 12)  # classes of lightness, and of both axes of colour
_WIDTHS = np.array([43, 9, 9])  # of a class
_LOWEST = np.array([0, 74, 74])  # of the first class; what lies outside counts as at the border
_BLUR = 0.7  # classes: neighbours are much the same colour
_BACKGROUND = 0.3  # weight of the image's colours, in instances: parts have other sides, too (D)
_RAREST = 1e-5

Shares = Float[np.ndarray, "864"]
"""Share of the pixels in each class of colour."""


@dataclass(frozen=True)
class FrameColors:
    """The class of colour (in CIE L*a*b*) of each pixel, and the `shares` of all classes."""

    classes: Int64[np.ndarray, "h w"]
    shares: Shares

    @classmethod
    def of(cls, rgb: Rgb) -> "FrameColors":
        """Those of an image."""
        lab = cv2.cvtColor(np.ascontiguousarray(rgb), cv2.COLOR_RGB2LAB).astype(np.int64)
        places = np.clip((lab - _LOWEST) // _WIDTHS, 0, np.array(_SIZES) - 1)
        classes = np.ravel_multi_index(tuple(np.moveaxis(places, -1, 0)), _SIZES)
        return cls(classes, _shares(classes))

    def at(self, verifier: Verifier, observation: Observation, pose_cam_obj: Pose) -> Shares:
        """Shares among the pixels that agree in depth with a pose of the verifier's object."""
        depth, shape = observation.depth, (observation.depth.shape[0], observation.depth.shape[1])
        camera = observation.camera_matrix
        rendered = render_depth(verifier.mesh, pose_cam_obj[None], camera, shape, threads=1)[0]
        agreeing = (rendered > 0.0) & (np.abs(depth - rendered) <= verifier.tau_depth)
        return _shares(self.classes[agreeing])


def _shares(classes: Int64[np.ndarray, "n"]) -> Shares:
    """How often each class is among pixels; those next to it count in part."""
    from scipy.ndimage import gaussian_filter  # heavy, and only bins with such parts need it

    count = np.bincount(classes.ravel(), minlength=int(np.prod(_SIZES))).astype(np.float64)
    shares = gaussian_filter(count.reshape(_SIZES), _BLUR, mode="constant").ravel()
    return np.asarray(shares / max(float(shares.sum()), 1.0))


def color_evidence(
    shares: Float[np.ndarray, "n 864"], weights: Values, background: Shares
) -> Values:
    """Mean log-likelihood ratio of each answer's colours: those of the part against the image's.

    The colours of the part are those of the answers, by their `weights`. An answer does not speak
    for itself: it is compared with the others. 0 where no other one has a weight.
    """
    total = weights @ shares
    part = total - weights[:, None] * shares + _BACKGROUND * background
    part /= (weights.sum() - weights + _BACKGROUND)[:, None]
    ratio = np.log((part + _RAREST) / (background + _RAREST))
    return np.asarray((shares * ratio).sum(axis=1))
