"""How well one pose fits the image: what a score is computed from, and what people want to know."""

from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Bool, Float, Float32

from hlp.arrays import Image, Mask, Pose
from hlp.geometry import project, transform
from hlp.kernels import compiled_ahead
from hlp.records import MILLIMETRES_PER_METRE
from hlp.refinement.texture import ColorAgreement, color_agreement
from hlp.refinement.verification import Observation, Verifier
from hlp.rendering.rasterizer import render_depth
from hlp.rendering.surface import broadest_side

_LEAST_PIXELS = 30
_INSIDE = np.ones((5, 5), np.uint8)  # px around a pixel that must lie in the silhouette
_LIMIT = 2.0  # τ_d: what is farther behind counts as this far
_SLOPE_SHARE = 0.05  # of the silhouette's longer side: radius over which depth is averaged
_LEAST_INSIDE = 0.1  # of a silhouette, by which the whole one is guessed
_OUTLINE = 64  # px: longer side of the silhouette whose share in the image is counted
_FULL = 0.8  # share of a window that must be visible


@dataclass(frozen=True)
class PoseFit:
    """How well one pose of an object fits the image.

    `cost` is the verification cost, in [0, 1]. `depth_correlation` and `slope` compare the shapes
    of model and image over the visible part of the silhouette, each by a correlation in [-1, 1]:
    that of the depths after a plane is subtracted, and that of their local slopes. A wrong pose
    agrees with something at the right place, but rarely with its shape. `residual_mm` is the median
    absolute difference in depth where both agree. `visible_fraction` is the fraction of the
    silhouette that lies in the image and that nothing nearer covers, `inside_fraction` that which
    lies in the image, covered or not. `color` and `contrast` are correlation and contrast of
    `texture.ColorAgreement`, `edge` is that of `verification.Evidence`: 0 where the image has an
    edge at every visible part of the outline, 1 where it has none.
    `plane_deviation_mm` is the standard deviation of the model's depth from the plane that fits it
    best: of a flat side, the correlations say little. It is infinite for an object with colours,
    which make up for it, and where too few pixels are seen. `appearance` is what colours and edges
    within the outline tell of a pose of an object without colours, given the other answers of the
    frame (`refinement.appearance`), and these themselves (`find.answers`, `find.frame_fits`); of a
    dull object with colours, what missing edges do: a log-likelihood ratio, 0 if nothing.
    `projected_share` is the silhouette's area relative to that of the object's broadest side, at
    most 1 and for objects with colours always: narrow sides look like many things. `pixels` is the
    number that agree, infinite for objects with colours.

    Examples:
        >>> (found,) = detector.detect(rgb, depth, camera_matrix, ["bear"], max_instances=1)
        >>> found.fit.residual_mm == found.residual_mm
        True
    """

    cost: float
    depth_correlation: float
    slope: float
    residual_mm: float
    visible_fraction: float
    color: float = 0.0
    contrast: float = 0.0
    edge: float = 0.0
    plane_deviation_mm: float = np.inf
    appearance: float = 0.0
    inside_fraction: float = 1.0
    projected_share: float = 1.0
    pixels: float = np.inf


def measure_fit(
    verifier: Verifier, observation: Observation, pose_cam_obj: Pose, with_colors: bool = True
) -> PoseFit:
    """How well a pose of the verifier's object fits an image; in half the time without colours."""
    evidence = verifier.evidence(observation, pose_cam_obj[None])
    drawn = verifier.depth_of(observation, pose_cam_obj)
    rendered, observed = drawn.depth, drawn.part(observation.depth)
    tau = np.float32(verifier.tau_depth)
    present = (rendered > 0.0) & (observed > 0.0) & np.isfinite(observed)
    difference = np.where(present, observed - rendered, np.float32(0.0))
    agreeing = present & (np.abs(difference) <= tau)
    apart = float(np.median(np.abs(difference[agreeing]))) if agreeing.any() else np.inf
    inside = cv2.erode((rendered > 0.0).astype(np.uint8), _INSIDE)
    visible = present & (difference >= -tau) & (inside > 0)
    # What is seen past the object is far behind it by chance: how far says nothing.
    seen = rendered + np.minimum(difference, _LIMIT * tau)
    of = observation, verifier.model, pose_cam_obj
    colors = color_agreement(*of) if with_colors else ColorAgreement()
    inside_fraction = _inside_fraction(verifier, observation, pose_cam_obj)
    correlation, deviation = depth_correlation(rendered, seen, visible)
    projected_share = 1.0
    if not (colored := verifier.model.mesh.colored):
        pixels = np.count_nonzero(rendered) / max(inside_fraction, _LEAST_INSIDE)
        projected_share = _projected_share(verifier, observation, pose_cam_obj, pixels)
    return PoseFit(
        cost=float(verifier.weigh(evidence)[0]),
        depth_correlation=correlation,
        slope=slope_correlation(rendered, seen, visible),
        residual_mm=apart * MILLIMETRES_PER_METRE,
        visible_fraction=inside_fraction * (1.0 - float(evidence.occluded[0])),
        color=colors.correlation,
        contrast=colors.contrast,
        edge=float(evidence.edge[0]),
        plane_deviation_mm=np.inf if colored else deviation * MILLIMETRES_PER_METRE,
        inside_fraction=inside_fraction,
        projected_share=projected_share,
        pixels=np.inf if colored else float(np.count_nonzero(agreeing)),
    )


def depth_correlation(first: Image, second: Image, among: Mask) -> tuple[float, float]:
    """Correlation of two depth images among some pixels, without the plane that fits each best.

    0 if there are too few pixels, or one of the images shows a plane. The second value is the
    standard deviation (m) of the first image from its plane; infinite for too few pixels.
    """
    products = _products(first, second, among)
    if (count := products[4, 4]) < _LEAST_PIXELS:
        return 0.0, np.inf  # a shape that is not seen speaks against a pose, unlike a plane
    spread = products[:4, :4] - np.outer(products[4, :4], products[4, :4]) / count
    plane = np.linalg.pinv(spread[:2, :2]) @ spread[:2, 2:]
    left = spread[2:, 2:] - spread[2:, :2] @ plane
    return _correlation(left, count), float(np.sqrt(max(left[0, 0], 0.0) / count))


@compiled_ahead(fastmath=True)
def _products(
    first: Float32[np.ndarray, "h w"],
    second: Float32[np.ndarray, "h w"],
    among: Bool[np.ndarray, "h w"],
) -> Float[np.ndarray, "5 5"]:
    """Sums of the products of x, y, both depths, and 1, among some pixels.

    The depths are those minus the first pixel's, so that little is lost by rounding.
    """
    sums, values, from_first, from_second = np.zeros((5, 5)), np.ones(5), 0.0, 0.0
    for y in range(among.shape[0]):
        for x in range(among.shape[1]):
            if among[y, x]:
                if sums[4, 4] == 0.0:
                    from_first, from_second = float(first[y, x]), float(second[y, x])
                values[0], values[1] = x, y
                values[2], values[3] = first[y, x] - from_first, second[y, x] - from_second
                for i in range(5):
                    for j in range(5):
                        sums[i, j] += values[i] * values[j]
    return sums


def slope_correlation(first: Image, second: Image, among: Mask) -> float:
    """Correlation of the slopes of two depth images, about the mean slope of each.

    Slopes are differences, to the right and down, of depths averaged among the given pixels over
    windows of about a tenth of their extent. 0 if there are too few, or one image shows a plane.
    """
    inside = among.view(np.uint8)
    if cv2.countNonZero(inside) < _LEAST_PIXELS:
        return 0.0
    extent = max(cv2.boundingRect(inside)[2:]) - 1
    radius = max(2, round(_SLOPE_SHARE * extent))
    window = (2 * radius + 1, 2 * radius + 1)
    weight, middle = among.astype(np.float32), np.float32(cv2.mean(first, inside)[0])
    # Depths minus a middle one keep the sums small: single precision.
    images = weight, (first - middle) * weight, (second - middle) * weight
    border = cv2.BORDER_CONSTANT
    count, *totals = (
        np.asarray(cv2.boxFilter(image, -1, window, normalize=False, borderType=border), np.float32)
        for image in images
    )
    sums = _slope_products(count, totals[0], totals[1], _FULL * window[0] ** 2, 2 * radius)
    if (counts := sums[:, 2, 2]).min() < _LEAST_PIXELS:
        return 0.0
    spreads = sums - sums[:, 2, :, None] * sums[:, 2, None] / counts[:, None, None]
    return _correlation(spreads.sum(axis=0), float(counts.sum()))


@compiled_ahead()
def _slope_products(
    count: Float32[np.ndarray, "h w"],
    first: Float32[np.ndarray, "h w"],
    second: Float32[np.ndarray, "h w"],
    full: float,
    apart: int,
) -> Float[np.ndarray, "2 3 3"]:
    """Sums of the products of both images' differences, and 1: to the right, and down.

    Means are totals over a `count`; those over more than `full` are compared, `apart` px.
    """
    sums, values = np.zeros((2, 3, 3)), np.ones(3)
    for y in range(count.shape[0]):
        for x in range(count.shape[1]):
            for down in range(2):
                v, u = y + down * apart, x + (1 - down) * apart
                if v >= count.shape[0] or u >= count.shape[1]:
                    continue
                if count[y, x] > full and count[v, u] > full:
                    values[0] = first[v, u] / count[v, u] - first[y, x] / count[y, x]
                    values[1] = second[v, u] / count[v, u] - second[y, x] / count[y, x]
                    for i in range(3):
                        for j in range(3):
                            sums[down, i, j] += values[i] * values[j]
    return sums


def _correlation(products: Float[np.ndarray, "k k"], samples: float) -> float:
    """Correlation by the products of two centred quantities, summed; 0 without spread."""
    spread = float(np.sqrt(max(products[0, 0] * products[1, 1], 0.0)))
    if spread <= 1e-12 * samples:  # less than a micrometre: rounding
        return 0.0
    return float(np.clip(products[0, 1] / spread, -1.0, 1.0))


def _projected_share(
    verifier: Verifier, observation: Observation, pose_cam_obj: Pose, pixels: float
) -> float:
    """Area of a silhouette of so many pixels, relative to the broadest side's; at most 1."""
    depth = float(transform(pose_cam_obj, verifier.model.centroid[None])[0, 2])
    pixel = depth**2 / float(observation.camera_matrix[0, 0] * observation.camera_matrix[1, 1])
    return min(pixels * pixel / broadest_side(verifier.mesh), 1.0)


def _inside_fraction(verifier: Verifier, observation: Observation, pose_cam_obj: Pose) -> float:
    """The fraction of the silhouette at a pose that lies in the image; 0 behind the camera."""
    points = transform(pose_cam_obj, verifier.mesh.vertices)
    if points[:, 2].min() <= 0.0:
        return 0.0
    pixels = project(points, observation.camera_matrix)
    low, high = pixels.min(axis=0), pixels.max(axis=0)
    height, width = observation.depth.shape
    end = np.array([width, height]) - 0.5
    if (low >= -0.5).all() and (high <= end).all():
        return 1.0
    scale = _OUTLINE / float(max((high - low).max(), 1e-6))
    camera_matrix = observation.camera_matrix.copy()
    camera_matrix[:2, 2] -= low
    camera_matrix[:2] *= scale
    side = _OUTLINE + 1
    shown = render_depth(verifier.mesh, pose_cam_obj[None], camera_matrix, (side, side), threads=1)
    y, x = np.nonzero(shown[0])
    found = np.column_stack([x, y]) / scale + low
    inside = ((found >= -0.5) & (found <= end)).all(axis=1)
    return float(inside.mean()) if len(inside) else 0.0
