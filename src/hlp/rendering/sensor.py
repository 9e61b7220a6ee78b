"""A Kinect-like sensor: errors of structured light and of a cheap colour camera.

It turns the clean renderings of demo scenes into sensor images; training patches have simpler noise
models of their own (`hlp.patches`). All functions take one image or a batch (..., h, w); all random
numbers come from the given generator. Noise and quantisation are uniform in disparity and therefore
grow with z² in depth (Khoshelham and Elberink, Sensors 2012, Eq. 8 and 10). Depth is missing where
the projector's light does not arrive.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Bool, Float, UInt8

Depth = Float[np.ndarray, "*b h w"]
_Pixels = Bool[np.ndarray, "*b h w"]
_JUMP = 0.015  # relative difference of depth above which neighbours show different surfaces
# σ = 1.5 mm and steps of 2.9 mm at 1 m.
_FOCAL = 572.0  # px, of images of full size
_BASELINE = 0.075  # m from projector to camera
_DISPARITY_NOISE, _DISPARITY_STEP = 0.064, 0.125  # px
_EDGE_MISSING = 0.25  # share of pixels at edges without a reading
_GRAZING_DEG = 78.0  # angle between ray and normal from which readings begin to fail
_HOLE_RATE = 2e-5  # holes begun per pixel
_FAR, _DEPTH_UNIT = 4.0, 0.001  # m: the largest depth measured, what depth is rounded to
_RGB_NOISE, _RGB_BLUR = 3.0, 0.6  # of 255, px
# Standard deviations of the logarithm of the channels' and of all channels' gain.
_WHITE_BALANCE, _EXPOSURE = 0.05, 0.15


@dataclass(frozen=True)
class Kinect:
    """A Kinect with `strength` times the usual noise; 0 is an ideal sensor without any error.

    The strength scales depth noise, holes, missing edges and all colour errors but blur.
    Quantisation, edge jitter, shadow, losses at grazing angles and the maximum depth do not depend
    on it unless it is 0. `edge_jitter` is how far (px) depth edges wander. With `binning` pixels of
    the sensor along a pixel of the image, depth is as exact as in an image of full size.
    """

    strength: float = 1.0
    edge_jitter: int = 1
    binning: float = 1.0


def depth_error(distance: float) -> float:
    """Standard deviation (m) of a Kinect's depth at a distance (m), quantisation included."""
    off = np.hypot(_DISPARITY_NOISE, _DISPARITY_STEP / np.sqrt(12.0))
    return float(off * distance**2 / (_FOCAL * _BASELINE))


def noisy_depth(depth: Depth, focal: float, rng: np.random.Generator, sensor: Kinect) -> Depth:
    """Sensor depth (m, float32, 0 = missing) of a clean `depth` (m, 0 = nothing).

    `focal` is the focal length (px) of the given images. Only what is inside the image casts a
    projector shadow.
    """
    clean = np.asarray(depth, dtype=np.float32)
    if sensor.strength == 0.0:
        return np.where(clean > 0.0, clean, np.float32(0.0))
    jumps = _jumps(clean)
    missing = (clean <= 0.0) | (clean > _FAR)
    missing |= projector_shadow(clean, focal, _BASELINE) | _grazing(clean, focal, rng)
    edges = np.flatnonzero(jumps)
    share = min(1.0, _EDGE_MISSING * sensor.strength)
    missing.reshape(-1)[edges[rng.random(len(edges), dtype=np.float32) < share]] = True
    missing |= _holes(clean.shape, rng, _HOLE_RATE * sensor.strength)
    read = np.where(missing, np.float32(0.0), clean)
    read = _jittered(read, jumps, rng, sensor.edge_jitter)
    return _measured(read, focal * sensor.binning, rng, _DISPARITY_NOISE * sensor.strength)


def noisy_rgb(
    rgb: UInt8[np.ndarray, "*b h w 3"], rng: np.random.Generator, sensor: Kinect
) -> UInt8[np.ndarray, "*b h w 3"]:
    """Colour with blur, noise, and random exposure and white balance of each image."""
    pictures = np.ascontiguousarray(rgb).reshape(-1, *rgb.shape[-3:])
    if sensor.strength > 0.0:
        pictures = np.stack([cv2.GaussianBlur(p, (0, 0), _RGB_BLUR) for p in pictures])
    gain = rng.normal(0.0, _EXPOSURE * sensor.strength, (len(pictures), 1, 1, 1))
    balance = rng.normal(0.0, _WHITE_BALANCE * sensor.strength, (len(pictures), 1, 1, 3))
    noise = rng.standard_normal(pictures.shape, dtype=np.float32)
    noise *= np.float32(_RGB_NOISE * sensor.strength)
    noise += pictures * np.exp(gain + balance).astype(np.float32)
    np.clip(np.rint(noise, out=noise), 0, 255, out=noise)
    return noise.astype(np.uint8).reshape(rgb.shape)


def projector_shadow(depth: Depth, focal: float, baseline: float) -> _Pixels:
    """Pixels whose surface is hidden from the projector, `baseline` (m) to the camera's right.

    A point in column x with disparity f·b/z is in the projector's column x − f·b/z. These columns
    increase from left to right, unless a nearer point further right occludes the point.
    """
    columns = np.arange(depth.shape[-1], dtype=np.float32)
    seen = depth > 0.0
    disparity = np.float32(focal * baseline) / np.where(seen, depth, np.float32(1.0))
    projected = np.where(seen, columns - disparity, np.float32(np.inf))
    nearest = np.minimum.accumulate(projected[..., ::-1], axis=-1)[..., ::-1]
    return np.asarray(seen & (projected > nearest + 0.5))


def _jumps(depth: Depth) -> _Pixels:
    """Pixels on either side of a depth discontinuity."""
    jumps = np.zeros(depth.shape, dtype=bool)
    across = np.abs(np.diff(depth, axis=-1)) > _JUMP * depth[..., 1:]
    jumps[..., 1:] |= across
    jumps[..., :-1] |= across
    down = np.abs(np.diff(depth, axis=-2)) > _JUMP * depth[..., 1:, :]
    jumps[..., 1:, :] |= down
    jumps[..., :-1, :] |= down
    return jumps


def _grazing(depth: Depth, focal: float, rng: np.random.Generator) -> _Pixels:
    """Pixels without depth because the surface is seen at a grazing angle.

    All readings fail half-way from the first angle to 90°. The slope along an axis is the smaller
    of the two one-sided differences, so that a step between two surfaces does not count as slope.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        scale = np.where(depth > 0.0, np.float32(focal) / depth, np.float32(0.0))
    slope = np.hypot(_smaller_difference(depth, -1), _smaller_difference(depth, -2)) * scale
    low, high = np.tan(np.radians(_GRAZING_DEG)), np.tan(np.radians((_GRAZING_DEG + 90.0) / 2))
    steep = np.flatnonzero(slope > low)
    share = (slope.reshape(-1)[steep] - low) / (high - low)
    lost = np.zeros(depth.shape, dtype=bool)
    lost.reshape(-1)[steep[rng.random(len(steep), dtype=np.float32) < share]] = True
    return lost


def _smaller_difference(depth: Depth, axis: int) -> Depth:
    """The smaller one of the absolute differences to the two neighbours along an axis."""
    step = np.abs(np.diff(depth, axis=axis))
    first, last = np.take(step, [0], axis=axis), np.take(step, [-1], axis=axis)
    before = np.concatenate([first, step], axis=axis)
    after = np.concatenate([step, last], axis=axis)
    return np.asarray(np.minimum(before, after))


def _holes(shape: tuple[int, ...], rng: np.random.Generator, rate: float) -> _Pixels:
    """Round holes of 1–4 px radius at random places, `rate` per pixel."""
    holes = np.zeros((int(np.prod(shape[:-2], dtype=np.int64)), *shape[-2:]), dtype=bool)
    count = int(rng.poisson(rate * holes.size))
    centers = [rng.integers(0, size, (count, 1)) for size in holes.shape]
    radii = rng.integers(1, 5, (count, 1))
    dy, dx = (offset.reshape(1, -1) for offset in np.mgrid[-4:5, -4:5])
    y, x = centers[1] + dy, centers[2] + dx
    inside = (dx * dx + dy * dy <= radii * radii) & (y >= 0) & (x >= 0)
    inside &= (y < shape[-2]) & (x < shape[-1])
    image = np.broadcast_to(centers[0], inside.shape)
    holes[image[inside], y[inside], x[inside]] = True
    return holes.reshape(shape)


def _jittered(depth: Depth, jumps: _Pixels, rng: np.random.Generator, radius: int) -> Depth:
    """Pixels at discontinuities take the depth of a random neighbour within `radius` (px)."""
    place = np.nonzero(jumps)
    count = len(place[0])
    height, width = depth.shape[-2:]
    rows = np.clip(place[-2] + rng.integers(-radius, radius + 1, count), 0, height - 1)
    columns = np.clip(place[-1] + rng.integers(-radius, radius + 1, count), 0, width - 1)
    jittered = depth.copy()
    jittered[place] = depth[(*place[:-2], rows, columns)]
    return jittered


def _measured(depth: Depth, focal: float, rng: np.random.Generator, noise: float) -> Depth:
    """Depth with noise (px) and quantisation in disparity, in whole units; 0 stays 0.

    The noise is correlated between neighbours, because the sensor matches windows.
    """
    seen = depth > 0.0
    scale, step = np.float32(focal * _BASELINE), np.float32(_DISPARITY_STEP)
    *images, height, width = depth.shape
    white = rng.standard_normal((*images, height + 1, width + 1), dtype=np.float32)
    rows = white[..., 1:, :] + white[..., :-1, :]
    smooth = (rows[..., 1:] + rows[..., :-1]) * np.float32(0.5)
    disparity = scale / np.where(seen, depth, np.float32(1.0))
    disparity += smooth * np.float32(noise)
    disparity = np.rint(disparity / step) * step
    read, unit = scale / np.maximum(disparity, np.float32(1e-3)), np.float32(_DEPTH_UNIT)
    read = np.rint(read / unit) * unit
    return np.where(seen, read, np.float32(0.0)).astype(np.float32, copy=False)
