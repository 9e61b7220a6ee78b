"""Where a depth image lies in the colour image, by the edges of both."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
from jaxtyping import Float

from hlp.arrays import Image, Mask, Rgb
from hlp.checks import Finding
from hlp.records import Frame

_REACH = 80  # px: shifts that are tried in both directions
_MOST = 3  # frames
_CELL = 2  # px of these shifts
_ENOUGH = 300  # depth edge pixels of an image; fewer say nothing
_GAP = 8  # px: sensors miss depth next to edges
_JUMP = 0.03  # of the depth, and as many centimetres as below
_LEAST_JUMP = 0.01  # m
_INSIDE = 0.4  # of the most edge pixels that lie in the colour image
CLEAR = 8.0  # agreement of the best place, in deviations of that of all places
_REGISTERED = 0.5  # share of it that there is at the image's own place where that is right
_NEAR = 4  # px: so small a shift is that of registered images
_TOLERATED = 6  # px; cameras that claim to be registered are up to 5 off


@dataclass(frozen=True)
class Registration:
    """Where a depth image lies in the colour image: scaled and turned about its middle, moved.

    `turn` in degrees clockwise, `right` and `down` in pixels of the colour image.
    """

    scale: float = 1.0
    turn: float = 0.0
    right: int = 0
    down: int = 0

    def motion(self, size: tuple[int, int]) -> Float[np.ndarray, "2 3"]:
        """Pixels of the depth image (width, height) to those of the colour image."""
        middle = (size[0] - 1) / 2, (size[1] - 1) / 2
        motion = cv2.getRotationMatrix2D(middle, -self.turn, self.scale)
        motion[:, 2] += self.right, self.down
        return np.asarray(motion)

    def frame(self, frame: Frame) -> Frame:
        """The frame with its depth where the colour image shows it."""
        size = frame.depth.shape[::-1]
        depth = cv2.warpAffine(frame.depth, self.motion(size), size, flags=cv2.INTER_NEAREST)
        return replace(frame, depth=np.asarray(depth))

    def depth_intrinsics(self, frame: Frame) -> str:
        """The key that states a depth camera which sees this, at the colour camera's place."""
        (fx, _, cx), (_, fy, cy) = frame.camera_matrix[:2]
        motion = cv2.invertAffineTransform(self.motion(frame.depth.shape[::-1]))
        numbers = (fx / self.scale, fy / self.scale, *(motion @ [cx, cy, 1.0]))
        return f"depth_intrinsics=[{','.join(f'{value:.1f}' for value in numbers)}]"

    def finding(self, frame: Frame, because: str = "") -> Finding:
        """What to do where depth lies here; `because` says what is better then."""
        problem = f"edges of depth lie on edges of colour when depth is {self}"
        advice = "Register depth to colour: take the camera's aligned depth stream"
        if not self.turn:
            advice += f", or give {self.depth_intrinsics(frame)}"
        because = because and f": {because}"
        return Finding("registration", "depth images", f"{problem}{because}", advice)

    def __str__(self) -> str:
        size = "" if self.scale == 1.0 else f"made {self.scale:.2f} times as large and "
        turn = f"turned by {self.turn:g}° and " if self.turn else ""
        return f"{size}{turn}moved by ({self.right}, {self.down}) px"


_OWN = Registration()
_COARSE = [Registration(1.06**step, turn) for step in range(-9, 10) for turn in (-3.0, 0.0, 3.0)]
_FINER = [Registration(1.015**step, turn) for step in range(-3, 4) for turn in (-1.0, 0.0, 1.0)]
_Agreement = Callable[[Registration], Image]
"""Strength of colour edges under the depth edges of a frame, for every shift (cells) of a place."""


def check_registration(frames: Sequence[Frame], whole: bool = False) -> list[Finding]:
    """Depth that is not registered to colour; see `find_registration`."""
    found = find_registration(frames, whole)
    return [] if found is None else [found.finding(frames[0])]


def find_registration(
    frames: Sequence[Frame], whole: bool = False, clear: float = CLEAR
) -> Registration | None:
    """Where depth lies in the colour images, by the edges of both; None if at its own place.

    Only shifts of 6 to 16 px are tried, or the `whole` of offsets, scales and turns: 0.7 s a frame.
    """
    edges = [known for frame in frames[:_MOST] if (known := _agreement(frame)) is not None]
    if not edges:
        return None
    if not whole:
        return _best_place(edges, [_OWN], 16, clear)
    found = _best_place(edges, _COARSE, _REACH, clear)
    if found is None:
        return None
    finer = [Registration(found.scale * each.scale, found.turn + each.turn) for each in _FINER]
    return _best_place(edges, finer, _REACH, clear) or found


def _agreement(frame: Frame) -> _Agreement | None:
    """What measures places of a frame's depth; None if there are few edges in it.

    Edges of one direction are compared with each other.
    """
    marked = _depth_edges(frame.depth), _depth_edges(frame.depth.T).T
    pixels = [np.argwhere(edges)[:, ::-1].astype(np.float64) for edges in marked]
    if sum(map(len, pixels)) < _ENOUGH:
        return None
    colors = _color_edges(frame.rgb)
    padded = [cv2.getOptimalDFTSize(2 * length) for length in colors[0].shape]
    spectra = [np.fft.rfft2(edges - edges.mean(), padded) for edges in colors]
    frame_spectrum = np.fft.rfft2(np.ones_like(colors[0]), padded)

    def agreement(place: Registration) -> Image:
        strength, inside = np.zeros(padded), np.zeros(padded)
        motion = place.motion(frame.depth.shape[::-1])
        for positions, spectrum in zip(pixels, spectra, strict=True):
            x, y = (np.floor((positions @ motion[:, :2].T + motion[:, 2]) / _CELL).astype(int)).T
            edges = np.zeros(padded)
            edges[y % padded[0], x % padded[1]] = 1.0
            against = np.conj(np.fft.rfft2(edges))
            strength += np.fft.irfft2(spectrum * against, padded)
            inside += np.fft.irfft2(frame_spectrum * against, padded)
        mean = strength / np.sqrt(np.maximum(inside, 1.0)) * (inside > _INSIDE * inside.max())
        shifts = np.arange(-_REACH // _CELL, _REACH // _CELL + 1)
        return np.asarray(mean[np.ix_(shifts, shifts)])

    return agreement


def _best_place(
    edges: Sequence[_Agreement], places: Sequence[Registration], reach: int, clear: float
) -> Registration | None:
    """Where depth lies of those places; None if that is its own place, or no place is clear."""
    all_places = {*places, _OWN}
    agreements = {place: np.sum([each(place) for each in edges], axis=0) for place in all_places}
    values = np.stack([*agreements.values()])
    middle = np.median(values)
    least = clear * 1.4826 * np.median(np.abs(values - middle))
    center, near = _REACH // _CELL, _NEAR // _CELL
    within, around = (slice(center - n, center + n + 1) for n in (reach // _CELL, near))
    best = max(places, key=lambda place: agreements[place][within, within].max())
    found = agreements[best][within, within]
    gain = found.max() - middle
    if gain < least or agreements[_OWN][around, around].max() - middle > _REGISTERED * gain:
        return None
    down, right = np.unravel_index(int(found.argmax()), found.shape)
    shift = (_CELL * int(cells) - reach for cells in (right, down))
    place = Registration(best.scale, best.turn, *shift)
    moved = best != _OWN or np.hypot(place.right, place.down) >= _TOLERATED
    return place if moved else None


def _color_edges(rgb: Rgb) -> list[Image]:
    """Gradients of cells along x and y, relative to those around, so that few do not decide."""
    grey = cv2.GaussianBlur(cv2.cvtColor(rgb, cv2.COLOR_RGB2GRAY).astype(np.float32), (0, 0), 1.5)
    along = cv2.Sobel(grey, cv2.CV_32F, 1, 0), cv2.Sobel(grey, cv2.CV_32F, 0, 1)
    usual = cv2.boxFilter(np.hypot(*along), -1, (31, 31)) + 2.0
    edges = (np.minimum(np.abs(gradient) / usual, 3.0) for gradient in along)
    return [cv2.resize(each, None, None, 1 / _CELL, 1 / _CELL, cv2.INTER_AREA) for each in edges]


def _depth_edges(depth: Image) -> Mask:
    """The nearer pixel of every jump in depth along rows, across small gaps."""
    columns = np.arange(depth.shape[1])
    last = np.maximum.accumulate(np.where(depth > 0, columns, -1), axis=1)
    before = np.pad(last[:, :-1], ((0, 0), (1, 0)), constant_values=-1)
    y, x = np.nonzero((depth > 0) & (before >= 0) & (columns - before <= _GAP))
    left = before[y, x]
    far, near = depth[y, left], depth[y, x]
    jump = np.abs(far - near) > _JUMP * np.minimum(near, far) + _LEAST_JUMP
    edges = np.zeros(depth.shape, dtype=bool)
    edges[y[jump], np.where(far < near, left, x)[jump]] = True
    return edges
