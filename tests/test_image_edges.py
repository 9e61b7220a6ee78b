"""Directions of gradients at edges, against steps whose direction is known."""

import cv2
import numpy as np
import pytest
from scipy import ndimage

from hlp.image_edges import (
    LOGARITHMS,
    NO_EDGE,
    STEPS,
    color_edges,
    edges,
    long_edges,
    noise_gradient,
)


def step_image(angle: float, low: tuple[int, ...], high: tuple[int, ...]) -> np.ndarray:
    """Two colours divided by a line through the middle, across which the gradient points."""
    y, x = np.mgrid[-40:41, -40:41]
    beyond = (x * np.cos(angle) + y * np.sin(angle)) > 0.2
    return np.where(beyond[..., None], np.array(high), np.array(low)).astype(np.uint8)


@pytest.mark.parametrize("turn", range(STEPS))
def test_an_edge_has_the_direction_across_it(turn: int) -> None:
    image = step_image(turn * np.pi / STEPS, (60, 60, 60), (160, 160, 160))
    found = color_edges(image)[8:-8, 8:-8]
    y, x = np.nonzero(found != NO_EDGE)
    across = (x - 32) * np.cos(turn * np.pi / STEPS) + (y - 32) * np.sin(turn * np.pi / STEPS)
    assert np.abs(across).max() < 2.0 and 60 < len(x) < 140
    away = (found[y, x] - turn) % STEPS
    assert (np.minimum(away, STEPS - away) <= 1).mean() > 0.95


def test_light_sign_and_channel_do_not_matter() -> None:
    dark, bright = (
        step_image(0.7, (20, 20, 30), (60, 20, 30)),
        step_image(0.7, (60, 0, 0), (20, 0, 0)),
    )
    first, second = (color_edges(image)[8:-8, 8:-8] for image in (dark, bright))
    both = (first != NO_EDGE) & (second != NO_EDGE)
    assert both.sum() > 50 and (first[both] == second[both]).mean() > 0.95


def test_what_is_smooth_or_faint_has_no_edge() -> None:
    y, x = np.mgrid[0:60, 0:80]
    ramp = np.repeat((60 + x + y)[..., None], 3, axis=2).astype(np.uint8)
    assert (color_edges(ramp) == NO_EDGE).all()
    assert (color_edges(step_image(0.0, (100,) * 3, (104,) * 3)) == NO_EDGE).all()


def noisy(image: np.ndarray, deviation: float) -> np.ndarray:
    noise = np.random.default_rng(0).normal(scale=deviation, size=image.shape)
    return np.clip(np.round(image + noise), 0, 255).astype(np.uint8)


def test_noise_is_no_edge_but_an_outline_in_it_is() -> None:
    wide = cv2.resize(step_image(0.0, (60,) * 3, (160,) * 3), (324, 324))
    image = noisy(wide, 20.0)
    at = np.zeros(image.shape[:2], bool)
    at[:, 160:168] = True
    assert (edges(LOGARITHMS[image], 0.04)[~at] != NO_EDGE).mean() > 0.15
    found = color_edges(image) != NO_EDGE
    assert found[~at].mean() < 0.002 and found[2:-2].any(axis=1).mean() > 0.98


@pytest.mark.parametrize("deviation", [0.0, 5.0, 20.0])
def test_the_gradient_of_noise_is_that_of_scipy(deviation: float) -> None:
    image = noisy(np.full((320, 320, 3), 128), deviation)
    image[:, 200:] = noisy(np.random.default_rng(1).integers(0, 256, (320, 120, 3)), 0.0)
    plain = ndimage.gaussian_filter(image[:, :190].astype(float), (1, 1, 0))
    channels = np.moveaxis(plain, 2, 0)
    gradients = [[ndimage.sobel(c, axis=axis) / 8.0 for c in channels] for axis in (0, 1)]
    expected = np.median(np.sqrt(np.square(gradients).sum(axis=0).max(axis=0)))
    assert noise_gradient(image) == pytest.approx(expected, rel=0.15)
    assert noise_gradient(image[:10]) == 0.0


def test_long_edges_are_those_of_many_touching_pixels() -> None:
    drawn = np.random.default_rng(0).random((80, 90)) < 0.15
    found = np.where(drawn, 3, NO_EDGE).astype(np.int8)
    group, _ = ndimage.label(drawn, structure=np.ones((3, 3)))
    expected = drawn & (np.bincount(group.ravel())[group] >= 16)
    assert expected.any() and (drawn & ~expected).any()
    assert np.array_equal(long_edges(found), np.where(expected, found, NO_EDGE))


def test_gradients_are_those_of_scipy() -> None:
    rng = np.random.default_rng(0)
    image = ndimage.gaussian_filter(rng.normal(size=(50, 70, 2)), (2, 2, 0)).astype(np.float32)
    found = edges(image, 1e-4)
    smooth = [
        ndimage.gaussian_filter(image[..., c].astype(float), 1, mode="mirror") for c in (0, 1)
    ]
    gradients = np.array([[ndimage.sobel(channel, axis=a) for channel in smooth] for a in (1, 0)])
    best = np.square(gradients).sum(axis=0).argmax(axis=0)[None]
    g_x, g_y = (np.take_along_axis(gradient, best, axis=0)[0] for gradient in gradients)
    expected = np.floor(np.arctan2(g_y, g_x) / np.pi * STEPS + 0.5).astype(int) % STEPS
    at = found[5:-5, 5:-5] != NO_EDGE
    assert at.sum() > 100
    assert (found[5:-5, 5:-5][at] == expected[5:-5, 5:-5][at]).mean() > 0.97
