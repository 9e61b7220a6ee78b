"""Edges of an image with the direction of their gradients: what depth does not show of flat things.

A plate on a table has hardly a step in depth at its outline, but nearly always one in colour. The
direction of a gradient, without its sign, depends neither on the light nor on the colours of object
and background (Hinterstoisser et al., LINEMOD, PAMI 2012).
"""

import cv2
import numpy as np
from jaxtyping import Float32, Int8

from hlp.arrays import Rgb
from hlp.kernels import compiled_ahead

STEPS = 16
"""Directions that are told apart, of half a turn: 0 is that of x, and they turn towards y."""
NO_EDGE = -1
_BLUR = 1.0  # px
_PART, _PLAIN = 16, 0.1  # px of a part of the image; share of the parts that is plain (D)
_USUAL = 1.25  # gradient of noise: most rendered scenes have less (D)
_NOISE = 6.0  # times what noise has beyond this: a larger gradient is an edge (D)
_LONG = 16  # pixels that touch; fewer are no outline (D)
_LEAST = 0.04  # of a gradient: difference of the colours' logarithms between neighbouring pixels
_ZERO = np.float32(0.0)
LOGARITHMS = np.log(np.arange(256, dtype=np.float32) + np.float32(20.0))
"""Of colours; 20 is added because the logarithm of dark ones is mostly noise."""


def color_edges(rgb: Rgb) -> Int8[np.ndarray, "h w"]:
    """Direction of the gradient at the edges of a colour image, `NO_EDGE` elsewhere.

    In poor light cameras are noisy: what more noise than usual may cause, and specks, are none.
    """
    noise = _NOISE * max(noise_gradient(rgb) - _USUAL, 0.0)
    found = edges(LOGARITHMS[rgb], _LEAST, noise)
    return long_edges(found) if noise > 0.0 else found


def long_edges(edges: Int8[np.ndarray, "h w"]) -> Int8[np.ndarray, "h w"]:
    """Edges that may be outlines: without specks, as noise has them."""
    found = (edges != NO_EDGE).view(np.uint8)
    _, group, measured, _ = cv2.connectedComponentsWithStats(found)
    long = measured[:, cv2.CC_STAT_AREA] >= _LONG
    return np.where(long[group], edges, np.int8(NO_EDGE))


def noise_gradient(rgb: Rgb) -> float:
    """How far noise changes the blurred colours from pixel to pixel: the gradient in plain parts.

    Plain is the tenth of the parts where the median gradient is smallest: where there is texture
    all over the image, faint texture is taken for noise.
    """
    blurred = cv2.GaussianBlur(rgb, (0, 0), _BLUR)
    height, width = (size // _PART for size in rgb.shape[:2])
    squared = np.zeros(1, dtype=np.float32)
    for order in ((1, 0), (0, 1)):
        gradient = cv2.Sobel(blurred, cv2.CV_16S, *order)[: height * _PART, : width * _PART]
        # Every second row of parts and pixel is enough.
        parts = gradient.reshape(height, _PART, width, _PART, 3)[::2, ::2, :, ::2]
        squared = squared + np.square(parts.astype(np.float32))
    if not squared.size:
        return 0.0
    strength = np.sqrt(squared.max(axis=-1)) / np.float32(8.0)
    return float(np.quantile(np.median(strength, axis=(1, 3)), _PLAIN))


def edges(
    image: Float32[np.ndarray, "h w c"], least: float, noise: float = 0.0
) -> Int8[np.ndarray, "h w"]:
    """Direction of the gradient where it is largest, of the channel where it is; else `NO_EDGE`.

    Gradients, a pixel, are those of the blurred image; smaller ones than `least` are no edges. In
    an image of logarithms, neither are those of less than `noise` in the colours themselves.
    """
    blurred = cv2.GaussianBlur(image, (0, 0), _BLUR).reshape(image.shape)
    strength = np.zeros(image.shape[:2], dtype=np.float32)
    direction = np.zeros(image.shape[:2], dtype=np.int8)
    found = np.full(image.shape[:2], NO_EDGE, dtype=np.int8)
    _gradients(blurred, np.float32(least), np.float32(noise), strength, direction)
    _thin(strength, direction, found)
    return found


@compiled_ahead(error_model="numpy")
def _gradients(
    image: Float32[np.ndarray, "h w c"],
    least: np.float32,
    noise: np.float32,
    strength: Float32[np.ndarray, "h w"],
    direction: Int8[np.ndarray, "h w"],
) -> None:
    """Sobel's gradient of the channel where it is largest: direction, and length if not faint."""
    height, width, channels = image.shape
    limit = (np.float32(8.0) * least) ** 2
    for y in range(1, height - 1):
        for x in range(1, width - 1):
            best, best_x, best_y, at = _ZERO, _ZERO, _ZERO, _ZERO
            for c in range(channels):
                along = image[y, x + 1, c] - image[y, x - 1, c]
                down = image[y + 1, x, c] - image[y - 1, x, c]
                rising = image[y + 1, x + 1, c] - image[y - 1, x - 1, c]
                falling = image[y - 1, x + 1, c] - image[y + 1, x - 1, c]
                g_x = np.float32(2.0) * along + rising + falling
                g_y = np.float32(2.0) * down + rising - falling
                squared = g_x * g_x + g_y * g_y
                if squared > best:
                    best, best_x, best_y, at = squared, g_x, g_y, image[y, x, c]
            if best >= limit and best >= (np.float32(8.0) * noise * np.exp(-at)) ** 2:
                strength[y, x] = np.sqrt(best)
                turn = np.arctan2(best_y, best_x) / np.float32(np.pi) * np.float32(STEPS)
                direction[y, x] = int(np.floor(turn + np.float32(0.5))) % STEPS


@compiled_ahead()
def _thin(
    strength: Float32[np.ndarray, "h w"],
    direction: Int8[np.ndarray, "h w"],
    found: Int8[np.ndarray, "h w"],
) -> None:
    """Keep the directions of pixels whose gradient is a maximum along its direction."""
    height, width = strength.shape
    for y in range(1, height - 1):
        for x in range(1, width - 1):
            here = strength[y, x]
            if here <= 0.0:
                continue
            eighth = ((direction[y, x] + 2) // 4) % 4
            right = 0 if eighth == 2 else 1
            down = 0 if eighth == 0 else (-1 if eighth == 3 else 1)
            if here >= strength[y + down, x + right] and here > strength[y - down, x - right]:
                found[y, x] = direction[y, x]
