"""A Kinect-like sensor: errors of structured light and of a cheap colour camera.

It turns the clean renderings of demo scenes into sensor images; training patches have simpler noise
models of their own (`hlp.patches`). All functions take one image or a batch (..., h, w); all random
numbers come from the given generator. Noise and quantisation are uniform in disparity and therefore
grow with z² in depth (Khoshelham and Elberink, Sensors 2012, Eq. 8 and 10). Depth is missing where
the projector's light does not arrive.
"""

from dataclasses import dataclass, replace

import cv2
import numpy as np
from jaxtyping import Bool, Float, UInt8

from hlp.errors import ConfigError

Depth = Float[np.ndarray, "*b h w"]
_JUMP = 0.015
"""Relative difference of depth above which neighbouring pixels show different surfaces."""


@dataclass(frozen=True)
class SensorSettings:
    """The sensor's errors. 0 turns an error off, except `grazing_deg` (90) and `far` (infinity).

    Depth: `baseline` from projector to camera (m); `disparity_noise` and `disparity_step` (px);
    `edge_jitter`, how far (px) depth edges wander; `edge_missing`, the share of edge pixels without
    a reading; `grazing_deg`, the angle between ray and normal from which readings begin to fail
    (all fail half-way from there to 90°); `hole_rate`, holes begun per pixel; `shadow`, whether
    what the projector cannot see is missing; `far`, the largest depth measured (m); `depth_unit`,
    what depth is rounded to (m).
    Colour: `rgb_noise` (of 255), `rgb_blur` (px), `white_balance` and `exposure` (standard
    deviations of the logarithm of the channels' and of all channels' gain).
    """

    baseline: float
    disparity_noise: float
    disparity_step: float
    edge_jitter: int
    edge_missing: float
    grazing_deg: float
    hole_rate: float
    shadow: bool
    far: float
    depth_unit: float
    rgb_noise: float
    rgb_blur: float
    white_balance: float
    exposure: float


KINECT = SensorSettings(
    baseline=0.075,
    disparity_noise=0.064,
    disparity_step=0.125,
    edge_jitter=1,
    edge_missing=0.25,
    grazing_deg=78.0,
    hole_rate=2e-5,
    shadow=True,
    far=4.0,
    depth_unit=0.001,
    rgb_noise=3.0,
    rgb_blur=0.6,
    white_balance=0.05,
    exposure=0.15,
)
"""σ = 1.5 mm and steps of 2.9 mm at 1 m for a focal length of 572 px."""


def kinect(strength: float) -> SensorSettings:
    """A Kinect with `strength` times the usual noise; 0 is an ideal sensor without any error.

    The strength scales depth noise, holes, missing edges and all colour errors but blur.
    Quantisation, edge jitter, shadow, losses at grazing angles and the maximum depth do not depend
    on it unless it is 0. Raises ValueError for a negative strength.
    """
    if not strength >= 0.0:
        raise ConfigError(f"sensor noise must be 0 or more, got {strength}")
    scaled = {
        name: getattr(KINECT, name) * strength
        for name in ("disparity_noise", "hole_rate", "rgb_noise", "white_balance", "exposure")
    }
    sensor = replace(KINECT, edge_missing=min(1.0, KINECT.edge_missing * strength), **scaled)
    if strength > 0.0:
        return sensor
    return replace(
        sensor,
        disparity_step=0.0,
        edge_jitter=0,
        grazing_deg=90.0,
        shadow=False,
        rgb_blur=0.0,
        far=np.inf,
        depth_unit=0.0,
    )


def noisy_depth(
    depth: Depth, focal: float, rng: np.random.Generator, settings: SensorSettings
) -> Depth:
    """Sensor depth (m, float32, 0 = missing) of a clean `depth` (m, 0 = nothing).

    `focal` is the focal length (px) of the given images. Only what is inside the image casts a
    projector shadow.
    """
    clean = np.asarray(depth, dtype=np.float32)
    jumps = _jumps(clean)
    missing = (clean <= 0.0) | (clean > settings.far)
    if settings.shadow:
        missing |= projector_shadow(clean, focal, settings.baseline)
    if settings.grazing_deg < 90.0:
        missing |= _grazing(clean, focal, rng, settings.grazing_deg)
    if settings.edge_missing > 0.0:
        edges = np.flatnonzero(jumps)
        lost = edges[rng.random(len(edges), dtype=np.float32) < settings.edge_missing]
        missing.reshape(-1)[lost] = True
    if settings.hole_rate > 0.0:
        missing |= _holes(clean.shape, rng, settings.hole_rate)
    read = np.where(missing, np.float32(0.0), clean)
    if settings.edge_jitter > 0:
        read = _jittered(read, jumps, rng, settings.edge_jitter)
    return _measured(read, focal, rng, settings)


def noisy_rgb(
    rgb: UInt8[np.ndarray, "*b h w 3"], rng: np.random.Generator, settings: SensorSettings
) -> UInt8[np.ndarray, "*b h w 3"]:
    """Colour with blur, noise, and random exposure and white balance of each image."""
    pictures = np.ascontiguousarray(rgb).reshape(-1, *rgb.shape[-3:])
    if settings.rgb_blur > 0.0:
        pictures = np.stack([cv2.GaussianBlur(p, (0, 0), settings.rgb_blur) for p in pictures])
    gain = rng.normal(0.0, settings.exposure, (len(pictures), 1, 1, 1))
    gain = np.exp(gain + rng.normal(0.0, settings.white_balance, (len(pictures), 1, 1, 3)))
    noise = rng.standard_normal(pictures.shape, dtype=np.float32)
    noise *= np.float32(settings.rgb_noise)
    noise += pictures * gain.astype(np.float32)
    np.clip(np.rint(noise, out=noise), 0, 255, out=noise)
    return noise.astype(np.uint8).reshape(rgb.shape)


def projector_shadow(depth: Depth, focal: float, baseline: float) -> Bool[np.ndarray, "*b h w"]:
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


def _jumps(depth: Depth) -> Bool[np.ndarray, "*b h w"]:
    """Pixels on either side of a depth discontinuity."""
    jumps = np.zeros(depth.shape, dtype=bool)
    across = np.abs(np.diff(depth, axis=-1)) > _JUMP * depth[..., 1:]
    jumps[..., 1:] |= across
    jumps[..., :-1] |= across
    down = np.abs(np.diff(depth, axis=-2)) > _JUMP * depth[..., 1:, :]
    jumps[..., 1:, :] |= down
    jumps[..., :-1, :] |= down
    return jumps


def _grazing(
    depth: Depth, focal: float, rng: np.random.Generator, start_deg: float
) -> Bool[np.ndarray, "*b h w"]:
    """Pixels without depth because the surface is seen at a grazing angle.

    The slope along an axis is the smaller of the two one-sided differences, so that a step between
    two surfaces does not count as slope.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        scale = np.where(depth > 0.0, np.float32(focal) / depth, np.float32(0.0))
    slope = np.hypot(_smaller_difference(depth, -1), _smaller_difference(depth, -2)) * scale
    low, high = np.tan(np.radians(start_deg)), np.tan(np.radians((start_deg + 90.0) / 2))
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


def _holes(
    shape: tuple[int, ...], rng: np.random.Generator, rate: float
) -> Bool[np.ndarray, "*b h w"]:
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


def _jittered(
    depth: Depth, jumps: Bool[np.ndarray, "*b h w"], rng: np.random.Generator, radius: int
) -> Depth:
    """Pixels at discontinuities take the depth of a random neighbour within `radius` (px)."""
    place = np.nonzero(jumps)
    count = len(place[0])
    height, width = depth.shape[-2:]
    rows = np.clip(place[-2] + rng.integers(-radius, radius + 1, count), 0, height - 1)
    columns = np.clip(place[-1] + rng.integers(-radius, radius + 1, count), 0, width - 1)
    jittered = depth.copy()
    jittered[place] = depth[(*place[:-2], rows, columns)]
    return jittered


def _measured(
    depth: Depth, focal: float, rng: np.random.Generator, settings: SensorSettings
) -> Depth:
    """Depth with noise and quantisation in disparity, rounded to `depth_unit`; 0 stays 0."""
    seen = depth > 0.0
    scale = np.float32(focal * settings.baseline)
    if settings.disparity_noise > 0.0 or settings.disparity_step > 0.0:
        disparity = scale / np.where(seen, depth, np.float32(1.0))
        if settings.disparity_noise > 0.0:
            disparity += _smooth_noise(depth.shape, rng) * np.float32(settings.disparity_noise)
        if settings.disparity_step > 0.0:
            step = np.float32(settings.disparity_step)
            disparity = np.rint(disparity / step) * step
        depth = scale / np.maximum(disparity, np.float32(1e-3))
    if settings.depth_unit > 0.0:
        unit = np.float32(settings.depth_unit)
        depth = np.rint(depth / unit) * unit
    return np.where(seen, depth, np.float32(0.0)).astype(np.float32, copy=False)


def _smooth_noise(shape: tuple[int, ...], rng: np.random.Generator) -> Depth:
    """Unit normal noise, correlated between neighbours, because the sensor matches windows."""
    white = rng.standard_normal((*shape[:-2], shape[-2] + 1, shape[-1] + 1), dtype=np.float32)
    rows = white[..., 1:, :] + white[..., :-1, :]
    return np.asarray((rows[..., 1:] + rows[..., :-1]) * np.float32(0.5))
