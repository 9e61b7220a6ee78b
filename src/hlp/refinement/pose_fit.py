"""How well one pose fits the image: what a score is computed from, and what people want to know."""

from dataclasses import astuple, dataclass, fields

import numpy as np
from jaxtyping import Bool, Float

from hlp.records import MILLIMETRES_PER_METRE
from hlp.refinement.verification import Observation, Verifier
from hlp.rendering.rasterizer import render_depth

_LEAST_PIXELS = 30
_MOST_PIXELS = 4000


@dataclass(frozen=True)
class PoseFit:
    """How well one pose of an object fits the image.

    `cost` is the verification cost, in [0, 1]. `relief` is the correlation, in [-1, 1], of the
    rendered and the observed depth after a plane is subtracted from each, over the pixels that
    agree in depth: a wrong pose agrees with something of the right place and slope, but rarely of
    the right relief. `residual_mm` is the median absolute difference in depth there.
    `visible_fraction` is the fraction of the silhouette that nothing nearer covers, `pixels` the
    number of agreeing pixels.
    """

    cost: float
    relief: float
    residual_mm: float
    visible_fraction: float
    pixels: float

    def as_array(self) -> Float[np.ndarray, "5"]:
        """The values in the order of the fields, for a file."""
        return np.array(astuple(self), dtype=np.float64)

    @classmethod
    def from_array(cls, values: Float[np.ndarray, "5"]) -> "PoseFit":
        """Inverse of `as_array`."""
        return cls(*(float(value) for value in values))


FIT_SIZE = len(fields(PoseFit))


def measure_fit(
    verifier: Verifier, observation: Observation, pose_cam_obj: Float[np.ndarray, "4 4"]
) -> PoseFit:
    """How well a pose of the verifier's object fits an image."""
    evidence = verifier.evidence(observation, pose_cam_obj[None])
    depth = observation.depth
    shape = (depth.shape[0], depth.shape[1])
    rendered = render_depth(
        verifier.mesh, pose_cam_obj[None], observation.camera_matrix, shape, threads=1
    )[0]
    agreeing = verifier.agreeing(observation, rendered)
    apart = np.abs(depth[agreeing] - rendered[agreeing])
    return PoseFit(
        cost=float(verifier.weigh(evidence)[0]),
        relief=relief_correlation(rendered, depth, agreeing),
        residual_mm=float(np.median(apart)) * MILLIMETRES_PER_METRE if len(apart) else np.inf,
        visible_fraction=1.0 - float(evidence.occluded[0]),
        pixels=float(len(apart)),
    )


def relief_correlation(
    first: Float[np.ndarray, "h w"],
    second: Float[np.ndarray, "h w"],
    among: Bool[np.ndarray, "h w"],
) -> float:
    """Correlation of two depth images among some pixels, without the plane that fits each best.

    0 if there are too few pixels, or one of the images shows a plane. Of many pixels every k-th is
    used.
    """
    y, x = np.nonzero(among)
    step = -(-len(y) // _MOST_PIXELS) if len(y) else 1
    y, x = y[::step], x[::step]
    if len(y) < _LEAST_PIXELS:
        return 0.0
    plane = np.column_stack([x - x.mean(), y - y.mean(), np.ones(len(x))])
    depths = np.column_stack([first[y, x], second[y, x]]).astype(np.float64)
    depths -= depths.mean(axis=0)
    left = depths - plane @ np.linalg.lstsq(plane, depths, rcond=None)[0]
    spread = np.sqrt(np.square(left).sum(axis=0))
    if (spread <= 1e-9 * len(y)).any():
        return 0.0
    return float(np.clip((left[:, 0] * left[:, 1]).sum() / spread.prod(), -1.0, 1.0))
