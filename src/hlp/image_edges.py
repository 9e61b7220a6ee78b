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
_LEAST = 0.04  # of a gradient: difference of the colours' logarithms between neighbouring pixels
LOGARITHMS = np.log(np.arange(256, dtype=np.float32) + np.float32(20.0))
"""Of colours; 20 is added because the logarithm of dark ones is mostly noise."""


def color_edges(rgb: Rgb) -> Int8[np.ndarray, "h w"]:
    """Direction of the gradient at the edges of a colour image, `NO_EDGE` elsewhere."""
    return edges(LOGARITHMS[rgb], _LEAST)


def edges(image: Float32[np.ndarray, "h w c"], least: float) -> Int8[np.ndarray, "h w"]:
    """Direction of the gradient where it is largest, of the channel where it is; else `NO_EDGE`.

    Gradients, a pixel, are those of the blurred image; smaller ones than `least` are no edges.
    """
    blurred = cv2.GaussianBlur(image, (0, 0), _BLUR).reshape(image.shape)
    strength = np.zeros(image.shape[:2], dtype=np.float32)
    direction = np.zeros(image.shape[:2], dtype=np.int8)
    found = np.full(image.shape[:2], NO_EDGE, dtype=np.int8)
    _gradients(blurred, np.float32(least), strength, direction)
    _thin(strength, direction, found)
    return found


@compiled_ahead(error_model="numpy")
def _gradients(
    image: Float32[np.ndarray, "h w c"],
    least: np.float32,
    strength: Float32[np.ndarray, "h w"],
    direction: Int8[np.ndarray, "h w"],
) -> None:
    """Sobel's gradient of the channel where it is largest: direction, and length if not faint."""
    height, width, channels = image.shape
    limit = (np.float32(8.0) * least) ** 2
    for y in range(1, height - 1):
        for x in range(1, width - 1):
            best, best_x, best_y = np.float32(0.0), np.float32(0.0), np.float32(0.0)
            for c in range(channels):
                along = image[y, x + 1, c] - image[y, x - 1, c]
                down = image[y + 1, x, c] - image[y - 1, x, c]
                rising = image[y + 1, x + 1, c] - image[y - 1, x - 1, c]
                falling = image[y - 1, x + 1, c] - image[y + 1, x - 1, c]
                g_x = np.float32(2.0) * along + rising + falling
                g_y = np.float32(2.0) * down + rising - falling
                squared = g_x * g_x + g_y * g_y
                if squared > best:
                    best, best_x, best_y = squared, g_x, g_y
            if best >= limit:
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
