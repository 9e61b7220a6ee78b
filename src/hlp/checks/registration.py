"""Whether the depth image lies on the colour image: edges of both should coincide."""

from collections.abc import Mapping, Sequence

import cv2
import numpy as np
from jaxtyping import Bool, Float, UInt8

from hlp.checks.finding import Finding
from hlp.method.find.detections import Detection, SearchResult
from hlp.method.track.tracking import TrackingResult
from hlp.records import Frame, ObjectModel

_REACH = 16  # px: shifts that are tried in both directions
_FEWEST = 300  # depth edge pixels of an image; fewer say nothing
_GAP = 8  # px: sensors miss depth next to edges
_JUMP = 0.03  # of the depth, and as many centimetres as below
_LEAST_JUMP = 0.01  # m
_CLEAR = 1.5  # contrast of the best shift, times the mean of all
_NEAR = 4  # px: the best contrast of so small a shift is that of registered images
_LOST = 0.65  # share of the best contrast above the mean that these have less of when unregistered
_TOLERATED = 6.0  # px; cameras that claim to be registered are up to 5 off


def check_registration(frames: Sequence[Frame]) -> list[Finding]:
    """Depth shifted against colour by 6 to 16 px."""
    means = [each for each in map(_contrast_by_shift, frames) if each is not None]
    if not means:
        return []
    contrast = np.mean(means, axis=0)
    y, x = np.unravel_index(int(contrast.argmax()), contrast.shape)
    best, mean = contrast[y, x], contrast.mean()
    near = slice(_REACH - _NEAR, _REACH + _NEAR + 1)
    registered = contrast[near, near].max()
    shift = np.array([x - _REACH, y - _REACH])
    clear = best > _CLEAR * mean and registered - mean < _LOST * (best - mean)
    if not clear or np.linalg.norm(shift) < _TOLERATED:
        return []
    return [
        Finding(
            "registration",
            "depth images",
            f"edges of depth lie on edges of colour when depth is moved by ({shift[0]:d}, "
            f"{shift[1]:d}) px",
            "Register depth to colour: take the camera's aligned depth stream",
        )
    ]


def _contrast_by_shift(frame: Frame) -> Float[np.ndarray, "s s"] | None:
    """Mean colour edge strength under the depth edges, for every shift; None if there are few."""
    strength = _color_edges(frame.rgb)
    edges = _depth_edges(frame.depth)
    edges[:_REACH], edges[-_REACH:] = False, False
    edges[:, :_REACH], edges[:, -_REACH:] = False, False
    y, x = np.nonzero(edges)
    if len(y) < _FEWEST:
        return None
    shifts = range(-_REACH, _REACH + 1)
    return np.array([[strength[y + dy, x + dx].mean() for dx in shifts] for dy in shifts])


def _color_edges(rgb: UInt8[np.ndarray, "h w 3"]) -> Float[np.ndarray, "h w"]:
    """Gradient relative to that of the neighbourhood, so that few strong edges do not decide."""
    grey = cv2.GaussianBlur(cv2.cvtColor(rgb, cv2.COLOR_RGB2GRAY).astype(np.float32), (0, 0), 1.0)
    gradient = np.hypot(cv2.Sobel(grey, cv2.CV_32F, 1, 0), cv2.Sobel(grey, cv2.CV_32F, 0, 1))
    relative = gradient / (cv2.boxFilter(gradient, -1, (31, 31)) + 1.0)
    return np.asarray(np.minimum(relative, 4.0))


def _depth_edges(depth: Float[np.ndarray, "h w"]) -> Bool[np.ndarray, "h w"]:
    """The nearer pixel of every jump in depth, along rows and columns, across small gaps."""
    edges = np.zeros(depth.shape, dtype=bool)
    for values, found in ((depth, edges), (depth.T, edges.T)):
        for line, marked in zip(values, found, strict=True):
            present = np.flatnonzero(line > 0)
            if len(present) < 2:
                continue
            first, second = present[:-1], present[1:]
            near, far = line[first], line[second]
            limit = _JUMP * np.minimum(near, far) + _LEAST_JUMP
            jump = (np.abs(far - near) > limit) & (second - first <= _GAP)
            marked[np.where(near < far, first, second)[jump]] = True
    return edges


_SHAPE_FITS = 0.8  # correlation of relief and of slope: wrong poses rarely reach it


def all_answers(found: SearchResult | TrackingResult) -> list[Detection]:
    """Detections and what was not good enough: a fault of the frame lowers the score."""
    return [*found.detections, *(each.answer for each in found.rejections if each.answer)]


def colored_answers(
    models: Mapping[str, ObjectModel], answers: Sequence[Detection]
) -> list[Detection]:
    """Poses of objects with colours whose shape fits. `models` are by the names of the answers."""
    return [
        each
        for each in answers
        if models[each.object].mesh.colored and min(each.fit.relief, each.fit.slope) >= _SHAPE_FITS
    ]
