"""Images of all windows of a frame at once, as the classifier reads them: 8-bit levels.

The same windows as `holistic.cut_windows` makes for training, in one compiled pass: each image row
that a window needs is resampled once and stays in the processor's cache.
"""

import cv2
import numpy as np
from jaxtyping import Float32, UInt8, UInt64

from hlp.arrays import Image, Points, Rgb, Rows
from hlp.kernels import compiled, compiled_ahead
from hlp.patches.holistic import HolisticSettings, Windows
from hlp.patches.sampling import area_shrink, halvings
from hlp.threads import ThreadTeam

_PAD = 2  # black pixels around an image, which stand for everything beyond it
_LANES = 4  # values of a pixel: colour, and one that keeps pixels aligned
_NOWHERE = -(1 << 40)
_CODES, _LEAST, _MOST = np.float32(127), np.float32(-127), np.float32(126)
_MIDDLE, _MISSING = np.float32(128), np.float32(255)  # of depth codes


class WindowImages:
    """Cuts windows from one frame: colour and, with `rgbd`, the `depth_code` as fourth channel.

    Those of `cut_windows`, but for a colour level where interpolation ends halfway between two.
    The team changes nothing but the time.
    """

    def __init__(
        self, rgb: Rgb, depth: Image, settings: HolisticSettings, team: ThreadTeam
    ) -> None:
        self._rgb = rgb
        self._depth = np.ascontiguousarray(depth, dtype=np.float32)
        self._settings = settings
        self._team = team
        self._padded: dict[int, Float32[np.ndarray, "h2 w2 4"]] = {}

    def cut(self, windows: Windows, metric_size: float) -> UInt8[np.ndarray, "n p p c"]:
        """Images of windows whose sides are those of an object of `metric_size` (m)."""
        p, with_depth = self._settings.resolution, self._settings.channels == "rgbd"
        out = np.empty((len(windows.sides), p, p, _LANES), dtype=np.uint8)
        levels = halvings(windows.sides, p, (self._rgb.shape[0], self._rgb.shape[1]))
        images = {int(level): self._halved(int(level)) for level in np.unique(levels)}
        places = np.column_stack([windows.centers, windows.sides]).astype(np.float64)
        depths, size = windows.depths.astype(np.float32), np.float32(metric_size)

        def work(first: int, last: int) -> None:
            for level, image in images.items():
                rows = first + np.flatnonzero(levels[first:last] == level)
                _cut_color(image, places, rows, 2**level, out)
            if with_depth:
                _cut_depth(self._depth, places, depths, size, first, last, out)

        self._team.map_ranges(work, len(places))
        return out if with_depth else np.ascontiguousarray(out[..., :3])

    def _halved(self, level: int) -> Float32[np.ndarray, "h2 w2 4"]:
        """The image, halved so often and padded."""
        if level not in self._padded:
            image = area_shrink(self._rgb, 2**level)
            four, border = cv2.cvtColor(image, cv2.COLOR_RGB2RGBA), cv2.BORDER_CONSTANT
            padded = cv2.copyMakeBorder(four, _PAD, _PAD + 1, _PAD, _PAD + 1, border)
            self._padded[level] = padded.astype(np.float32)
        return self._padded[level]


@compiled_ahead()
def _cut_color(
    image: Float32[np.ndarray, "h2 w2 4"],
    places: Points,
    rows: Rows,
    factor: int,
    out: UInt8[np.ndarray, "n p p 4"],
) -> None:
    height, width = image.shape[0] - 2 * _PAD - 1, image.shape[1] - 2 * _PAD - 1
    p = out.shape[1]
    starts = np.empty(p, np.uint64)
    weights = np.empty(p, np.float32)
    lines = np.empty((2, p * _LANES), np.float32)
    for r in rows:
        for i in range(p):
            x = _position(places[r, 0], places[r, 2], i, p, factor)
            low = np.floor(x)
            weights[i] = x - low
            starts[i] = _LANES * (min(max(np.int64(low), -_PAD), width) + _PAD)
        held = _NOWHERE  # the image's row in lines[held & 1]; the one below is in the other
        for j in range(p):
            y = _position(places[r, 1], places[r, 2], j, p, factor)
            low = np.floor(y)
            k = min(max(np.int64(low), -_PAD), height)
            if k != held:
                if k != held + 1:
                    _resample(image[k + _PAD].reshape(-1), starts, weights, lines[k & 1])
                _resample(image[k + _PAD + 1].reshape(-1), starts, weights, lines[(k + 1) & 1])
                held = k
            _mix(lines[k & 1], lines[(k + 1) & 1], y - low, out[r, j].reshape(-1))


@compiled_ahead()
def _cut_depth(
    depth: Float32[np.ndarray, "h w"],
    places: Points,
    centers: Float32[np.ndarray, "n"],
    metric_size: np.float32,
    first: int,
    last: int,
    out: UInt8[np.ndarray, "n p p 4"],
) -> None:
    height, width = depth.shape
    p = out.shape[1]
    columns = np.empty(p, np.int64)
    line = np.empty(p, np.float32)
    codes = np.empty(p, np.uint8)
    for r in range(first, last):
        for i in range(p):
            k = np.int64(np.rint(_position(places[r, 0], places[r, 2], i, p, 1)))
            columns[i] = k if 0 <= k < width else -1
        held = np.int64(_NOWHERE)
        for j in range(p):
            k = np.int64(np.rint(_position(places[r, 1], places[r, 2], j, p, 1)))
            if k != held:
                held = k
                line[:] = 0
                if 0 <= k < height:
                    for i in range(p):
                        if columns[i] >= 0:
                            line[i] = depth[k, columns[i]]
                _code(line, centers[r], metric_size, codes)
            for i in range(p):
                out[r, j, i, 3] = codes[i]


@compiled()
def _position(center: float, side: float, i: int, p: int, factor: int) -> np.float32:
    """Where output pixel i samples the image that was shrunk by `factor`."""
    offset = side * ((i + 0.5) / p - 0.5)
    return np.float32((center + offset + 0.5) / factor - 0.5)


@compiled()
def _resample(
    row: Float32[np.ndarray, "w4"],
    starts: UInt64[np.ndarray, "p"],
    weights: Float32[np.ndarray, "p"],
    line: Float32[np.ndarray, "p4"],
) -> None:
    # Unsigned indices: the compiler need not look for negative ones.
    one, two, three, four = np.uint64(1), np.uint64(2), np.uint64(3), np.uint64(4)
    for i in range(len(starts)):
        k, w = starts[i], weights[i]
        a, b, c = row[k], row[k + one], row[k + two]
        d, e, f = row[k + four], row[k + four + one], row[k + four + two]
        o = four * np.uint64(i)
        line[o] = a + w * (d - a)
        line[o + one] = b + w * (e - b)
        line[o + two] = c + w * (f - c)
        line[o + three] = np.float32(0)


@compiled()
def _mix(
    upper: Float32[np.ndarray, "p4"],
    lower: Float32[np.ndarray, "p4"],
    weight: np.float32,
    line: UInt8[np.ndarray, "p4"],
) -> None:
    """A whole colour level between two rows."""
    for c in range(len(line)):
        line[c] = np.int32(np.rint(upper[c] + weight * (lower[c] - upper[c])))


@compiled()
def _code(
    line: Float32[np.ndarray, "p"],
    center: np.float32,
    size: np.float32,
    codes: UInt8[np.ndarray, "p"],
) -> None:
    """`depth_code` of depths."""
    for i in range(len(line)):
        code = min(max(np.rint((line[i] - center) / size * _CODES), _LEAST), _MOST) + _MIDDLE
        codes[i] = np.int32(code if line[i] > 0 else _MISSING)
