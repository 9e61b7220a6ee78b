"""How well one pose fits the image: what a score is computed from, and what people want to know."""

from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Float

from hlp.arrays import Image, Mask, Pose
from hlp.geometry import project, transform
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
    frame (`refinement.appearance`), and these themselves (`find.answers`, `find.frame_fits`): a
    log-likelihood ratio, 0 if nothing. `projected_share` is the silhouette's area relative to that
    of the object's broadest side, at most 1 and for objects with colours always: narrow sides look
    like many things. `pixels` is the number that agree, infinite for objects with colours.

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
    left = _without_plane([first, second], among)
    if len(left) == 0:
        return 0.0, np.inf  # a shape that is not seen speaks against a pose, unlike a plane
    return _correlation([left[:, 0]], [left[:, 1]]), float(np.sqrt(np.square(left[:, 0]).mean()))


def _without_plane(images: list[Image], among: Mask) -> Float[np.ndarray, "n k"]:
    """Depths of images among some pixels minus their best planes; none if the pixels are few."""
    y, x = np.nonzero(among)
    if len(y) < _LEAST_PIXELS:
        return np.zeros((0, len(images)))
    plane = np.column_stack([x - x.mean(), y - y.mean(), np.ones(len(x))])
    depths = np.column_stack([image[y, x] for image in images]).astype(np.float64)
    depths -= depths.mean(axis=0)
    flat = np.linalg.pinv(plane.T @ plane) @ (plane.T @ depths)
    return np.asarray(depths - plane @ flat)


def slope_correlation(first: Image, second: Image, among: Mask) -> float:
    """Correlation of the slopes of two depth images, about the mean slope of each.

    Slopes are differences, to the right and down, of depths averaged among the given pixels over
    windows of about a tenth of their extent. 0 if there are too few, or one image shows a plane.
    """
    y, x = np.nonzero(among)
    if len(y) < _LEAST_PIXELS:
        return 0.0
    radius = max(2, round(_SLOPE_SHARE * float(max(np.ptp(x), np.ptp(y)))))
    window = (2 * radius + 1, 2 * radius + 1)
    weight = among.astype(np.float32)

    def total(image: Image) -> Image:
        single = np.asarray(image, dtype=np.float32)
        return np.asarray(
            cv2.boxFilter(single, -1, window, normalize=False, borderType=cv2.BORDER_CONSTANT)
        )

    count = total(weight)
    full = count > _FULL * window[0] * window[1]
    middle = float(np.median(first[y, x]))  # keeps the sums small: single precision
    means = [total((d - middle) * weight) / np.maximum(count, 1.0) for d in (first, second)]
    across, down = (slice(None), slice(2 * radius, None)), (slice(2 * radius, None), slice(None))
    back, up = (slice(None), slice(None, -2 * radius)), (slice(None, -2 * radius), slice(None))
    slopes: tuple[list[np.ndarray], list[np.ndarray]] = ([], [])
    for ahead, behind in ((across, back), (down, up)):
        both = full[ahead] & full[behind]
        if np.count_nonzero(both) < _LEAST_PIXELS:
            return 0.0
        for mean, found in zip(means, slopes, strict=True):
            found.append((mean[ahead] - mean[behind])[both].astype(np.float64))
    return _correlation(*slopes)


def _correlation(first: list[np.ndarray], second: list[np.ndarray]) -> float:
    """Correlation over several groups of samples, each about its own mean; 0 without spread."""
    pairs = [(a - a.mean(), b - b.mean()) for a, b in zip(first, second, strict=True)]
    product = sum(float(a @ b) for a, b in pairs)
    spread = np.sqrt(sum(float(a @ a) for a, _ in pairs) * sum(float(b @ b) for _, b in pairs))
    samples = sum(len(a) for a, _ in pairs)
    if spread <= 1e-12 * samples:  # less than a micrometre: rounding
        return 0.0
    return float(np.clip(product / spread, -1.0, 1.0))


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
