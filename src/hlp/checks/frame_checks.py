"""What is seen in frames alone, without poses or a search."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
from jaxtyping import Float

from hlp.arrays import Image, Mask, Rgb
from hlp.checks import Finding
from hlp.objects.mesh_colors import SMALL
from hlp.records import Frame, ObjectModel


def check_frames(frames: Sequence[Frame], models: Sequence[ObjectModel]) -> list[Finding]:
    """What takes no search: three seconds for all. `models` are looked for, or none."""
    if not frames:
        return []
    return [*check_first_frame(frames[0], models), *check_registration(frames, whole=True)]


def check_first_frame(frame: Frame, models: Sequence[ObjectModel]) -> list[Finding]:
    """What one frame is enough for: intrinsics, and the units of depth and meshes."""
    return [*check_intrinsics(frame), *check_object_size(models), *check_depth_scale(frame, models)]


_OFF_CENTER = 0.15  # of the image's width or height
_FOCAL = (0.3, 4.0)  # times the image's width: 118° to 14° of view
_RATIO = 1.5  # of both focal lengths
_SMALLEST, _LARGEST = 24.0, 3.0  # px of an object that can be found; times the image's width
_USUAL = (0.15, 8.0)  # m: where half of the depth of an indoor scene begins


def check_intrinsics(frame: Frame) -> list[Finding]:
    """Intrinsics of images of another size, or with exchanged or impossible numbers."""
    height, width = frame.depth.shape
    matrix = frame.camera_matrix
    x, y, fx, fy = matrix[0, 2], matrix[1, 2], matrix[0, 0], matrix[1, 1]
    found = list[tuple[str, str]]()
    off = np.abs(matrix[:2, 2] - [(width - 1) / 2, (height - 1) / 2]) / [width, height]
    if off.max() > _OFF_CENTER:
        found.append(
            (
                f"the principal point ({x:.0f}, {y:.0f}) is far from their middle",
                "They belong to images of another size or to a crop: take those of this stream",
            )
        )
    low, high = _FOCAL[0] * width, _FOCAL[1] * width
    if not (low <= fx <= high and low <= fy <= high):
        problem = f"focal lengths of {fx:.0f} and {fy:.0f} px are those of no depth camera"
        found.append((problem, "Give fx and fy in pixels, not in millimetres"))
    elif max(fx / fy, fy / fx) > _RATIO:
        problem = f"fx = {fx:.0f} and fy = {fy:.0f} px are very different"
        found.append((problem, "Check the order of the numbers: fx, fy, cx, cy"))
    where = f"images of {width}x{height}"
    return [Finding("intrinsics", where, problem, advice) for problem, advice in found]


def check_depth_scale(frame: Frame, models: Sequence[ObjectModel]) -> list[Finding]:
    """Depth in another unit: the objects would be too small or too large to be seen."""
    present = frame.depth[frame.depth > 0]
    if not len(present):
        return []
    median, near, far = (float(np.percentile(present, share)) for share in (50, 10, 90))
    focal = float(frame.camera_matrix[0, 0])
    diameters = [model.diameter for model in models]
    if models and focal * max(diameters) / near < _SMALLEST:
        size = focal * max(diameters) / near
        problem = f"{models[0].name} would be {size:.0f} px large at most"
    elif models and focal * min(diameters) / far > _LARGEST * frame.depth.shape[1]:
        problem = f"{models[0].name} would be larger than the image"
    elif not _USUAL[0] <= median <= _USUAL[1]:
        problem = "few depth cameras measure that"
    else:
        return []
    return [
        Finding(
            "depth scale",
            "depth images",
            f"half of the depth is nearer than {median:.3g} m: {problem}",
            "Give depth_scale, in millimetres per unit of the depth images",
        )
    ]


def check_object_size(models: Sequence[ObjectModel]) -> list[Finding]:
    """Objects so small that their meshes may be in centimetres."""
    return [
        Finding(
            "mesh unit",
            model.name,
            f"it is {model.diameter * 1000:.0f} mm large",
            f"If it is {model.diameter * 10000:.0f} mm in truth, its mesh is in centimetres: learn "
            "it with mesh_scale=0.01",
        )
        for model in models
        if model.diameter < SMALL
    ]


_SCALES, _TURNS = tuple(1.06**step for step in range(-9, 10)), (-3.0, 0.0, 3.0)  # degrees
_FINER = tuple(1.015**step for step in range(-3, 4)), (-1.0, 0.0, 1.0)
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
        x, y = motion @ [cx, cy, 1.0]
        numbers = (fx / self.scale, fy / self.scale, x, y)
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
        parts = [f"moved by ({self.right}, {self.down}) px"]
        if self.turn:
            parts.insert(0, f"turned by {self.turn:g}°")
        if self.scale != 1.0:
            parts.insert(0, f"made {self.scale:.2f} times as large")
        return " and ".join(parts)


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
    edges = [known for frame in frames[:_MOST] if (known := _Edges.of(frame)) is not None]
    if not edges:
        return None
    if not whole:
        return _best_place(edges, (1.0,), (0.0,), 16, clear)
    found = _best_place(edges, _SCALES, _TURNS, _REACH, clear)
    if found is None:
        return None
    scales = [found.scale * scale for scale in _FINER[0]]
    return (
        _best_place(edges, scales, [found.turn + turn for turn in _FINER[1]], _REACH, clear)
        or found
    )


@dataclass(frozen=True)
class _Edges:
    """A frame's edges along each axis: those of depth as pixels, those of colour as a spectrum.

    Edges of one direction are compared with each other.
    """

    pixels: tuple[np.ndarray, np.ndarray]
    spectra: tuple[np.ndarray, np.ndarray]
    inside: np.ndarray
    size: tuple[int, int]
    padded: tuple[int, int]

    @classmethod
    def of(cls, frame: Frame) -> "_Edges | None":
        """Those of a frame; None if there are few in the depth image."""
        depth = frame.depth
        marked = _depth_edges(depth), _depth_edges(depth.T).T
        x, y = (np.argwhere(edges)[:, ::-1].astype(np.float64) for edges in marked)
        if len(x) + len(y) < _ENOUGH:
            return None
        colors = [
            cv2.resize(edges, None, fx=1 / _CELL, fy=1 / _CELL, interpolation=cv2.INTER_AREA)
            for edges in _color_edges(frame.rgb)
        ]
        height, width = colors[0].shape
        padded = cv2.getOptimalDFTSize(2 * height), cv2.getOptimalDFTSize(2 * width)
        first, second = (np.fft.rfft2(edges - edges.mean(), padded) for edges in colors)
        inside = np.fft.rfft2(np.ones_like(colors[0]), padded)
        return cls((x, y), (first, second), inside, depth.shape[::-1], padded)

    def agreement(self, place: Registration) -> Image:
        """Strength of colour edges under the depth edges, for every shift (cells) of a place."""
        strength, inside = np.zeros(self.padded), np.zeros(self.padded)
        for pixels, spectrum in zip(self.pixels, self.spectra, strict=True):
            motion = place.motion(self.size)
            x, y = (np.floor((pixels @ motion[:, :2].T + motion[:, 2]) / _CELL).astype(int)).T
            edges = np.zeros(self.padded)
            edges[y % self.padded[0], x % self.padded[1]] = 1.0
            against = np.conj(np.fft.rfft2(edges))
            strength += np.fft.irfft2(spectrum * against, self.padded)
            inside += np.fft.irfft2(self.inside * against, self.padded)
        mean = strength / np.sqrt(np.maximum(inside, 1.0)) * (inside > _INSIDE * inside.max())
        shifts = np.arange(-_REACH // _CELL, _REACH // _CELL + 1)
        return np.asarray(mean[np.ix_(shifts, shifts)])


def _best_place(
    edges: Sequence[_Edges],
    scales: Sequence[float],
    turns: Sequence[float],
    reach: int,
    clear: float,
) -> Registration | None:
    """Where depth lies of those places; None if that is its own place, or no place is clear."""
    places = [Registration(scale, turn) for scale in scales for turn in turns]
    own = Registration()
    agreements = {
        place: np.sum([each.agreement(place) for each in edges], axis=0) for place in {*places, own}
    }
    values = np.stack([*agreements.values()])
    middle = np.median(values)
    least = clear * 1.4826 * np.median(np.abs(values - middle))
    center, near = _REACH // _CELL, _NEAR // _CELL
    within, around = (slice(center - n, center + n + 1) for n in (reach // _CELL, near))
    best = max(places, key=lambda place: agreements[place][within, within].max())
    found = agreements[best][within, within]
    gain = found.max() - middle
    if gain < least or agreements[own][around, around].max() - middle > _REGISTERED * gain:
        return None
    down, right = np.unravel_index(int(found.argmax()), found.shape)
    shift = (_CELL * int(cells) - reach for cells in (right, down))
    place = Registration(best.scale, best.turn, *shift)
    moved = best != own or np.hypot(place.right, place.down) >= _TOLERATED
    return place if moved else None


def _color_edges(rgb: Rgb) -> list[Image]:
    """Gradients along x and y relative to the neighbourhood's, so that few edges do not decide."""
    grey = cv2.GaussianBlur(cv2.cvtColor(rgb, cv2.COLOR_RGB2GRAY).astype(np.float32), (0, 0), 1.5)
    along = cv2.Sobel(grey, cv2.CV_32F, 1, 0), cv2.Sobel(grey, cv2.CV_32F, 0, 1)
    usual = cv2.boxFilter(np.hypot(*along), -1, (31, 31)) + 2.0
    return [np.minimum(np.abs(gradient) / usual, 3.0) for gradient in along]


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
