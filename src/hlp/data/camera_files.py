"""Intrinsics as cameras, ROS, Open3D and OpenCV write them; images brought to such a camera."""

import re
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from jaxtyping import Float

from hlp.arrays import CameraMatrix, Image
from hlp.errors import InputError, MissingFileError
from hlp.files import parse_json, parse_yaml
from hlp.schemas import camera_matrix, number

_MOST_BYTES = 1024**2
_MOST_JSON = 16 * 1024**2  # scene_camera.json of thousands of frames
_LARGEST = 100_000  # px of an image's side
_MOST_BENT = 1e4  # of a coefficient of distortion
_LEAST_SEEN = 0.1  # of the image that an undistorted one shows
_LONGEST_UNIT = 1e6  # mm
# Keys that hold a matrix or fx, fy, cx, cy: BOP's, RealSense's, plain ones, Open3D's, OpenCV's and
# ROS 1's files, ROS's messages.
_FORMS = (
    ("cam_K",), ("fx", "fy", "ppx", "ppy"), ("fx", "fy", "cx", "cy"), ("intrinsic_matrix",),
    ("camera_matrix",), ("K",), ("k",),
)  # fmt: skip
_NO_FORM = (
    "no cam_K (nine numbers), nor fx, fy, cx and cy, nor what ROS (K or camera_matrix), RealSense "
    "(ppx, ppy) or Open3D (intrinsic_matrix) write"
)
_WRAPPERS = ("intrinsic", "intrinsics", "camera_info", "color")
_DISTORTION = ("coeffs", "distortion_coefficients", "D", "d", "dist_coeffs", "distortion")
_SIZES = (("width", "height"), ("image_width", "image_height"))
# Numbers of coefficients by ROS's, RealSense's and OpenCV's names of models; RealSense writes five
# for a fisheye, the last one 0.
_PINHOLE, _FISHEYE = (4, 5, 8, 12, 14), (4, 5)
_MODELS = {
    "plumb_bob": _PINHOLE, "rational_polynomial": _PINHOLE, "brown_conrady": _PINHOLE,
    "modified_brown_conrady": _PINHOLE, "radtan": _PINHOLE, "pinhole": _PINHOLE, "": _PINHOLE,
    "equidistant": _FISHEYE, "fisheye": _FISHEYE, "kannala_brandt4": _FISHEYE, "none": (),
}  # fmt: skip


@dataclass(frozen=True)
class Camera:
    """Intrinsics of a camera, as a file states them.

    `matrix` in pixels; `size` (width, height) of its images, None if not stated. `distortion` are
    OpenCV's coefficients (k1, k2, p1, p2, k3, …; of a `fisheye` k1 … k4), empty without distortion.
    `depth_scale` is mm per unit of the depth images, None if not stated.
    """

    matrix: CameraMatrix
    size: tuple[int, int] | None = None
    distortion: tuple[float, ...] = ()
    fisheye: bool = False
    depth_scale: float | None = None


def read_camera(given: str | Sequence[float], key: str = "intrinsics") -> Camera:
    """The camera in a file, or of four (fx, fy, cx, cy) or nine numbers (px).

    The file may be JSON, YAML or text: `cam_K` or fx, fy, cx, cy; BOP's scene_camera.json if all
    frames have one camera; a RealSense's intrinsics; ROS's camera_info; Open3D's; OpenCV's; or the
    numbers of a 3×3 matrix. Raises MissingFileError, and InputError or DataError for anything else;
    all name `key`.
    """
    if not isinstance(given, str):
        return Camera(_matrix(list(given), key))
    path = Path(given)
    if not path.is_file():
        raise MissingFileError(f"{key} is not a file: {path} (set {key}=FILE or [fx,fy,cx,cy])")
    where = f"{key}, {path}"
    content = _parsed(path, where)
    if isinstance(content, list):
        return Camera(_matrix(content, where))
    if isinstance(content, dict):
        return _camera(_one_camera(content, where), where)
    raise InputError(f"{where}: it holds neither keys nor nine or four numbers")


def _parsed(path: Path, where: str) -> Any:
    """Numbers of a plain text as a list; JSON and YAML as what they say."""
    is_json = path.suffix.lower() == ".json"
    if (size := path.stat().st_size) > (most := _MOST_JSON if is_json else _MOST_BYTES):
        raise InputError(f"{where} has {size} bytes: intrinsics have {most} at most")
    try:
        text = path.read_text(encoding="utf-8-sig")
    except UnicodeDecodeError as error:
        raise InputError(f"{where} is not text: give JSON, YAML or nine numbers") from error
    words = re.split(r"[\s,;\[\]]+", text.strip(" \t\r\n,;[]"))
    with suppress(ValueError):
        return [number(word) for word in words]
    if is_json:
        return parse_json(text, where)
    # OpenCV writes a first line and tags that other readers of YAML do not know.
    plain = re.sub(r"^%YAML.*\n", "", text).replace("!!opencv-matrix", "")
    return parse_yaml(plain, where)


def _one_camera(content: dict[Any, Any], where: str) -> Mapping[str, Any]:
    """The mapping that holds the camera, without what is wrapped around it."""
    frames = [frame for name, frame in content.items() if str(name).isdecimal()]
    if frames and len(frames) == len(content):  # scene_camera.json: a camera for each frame
        if not all(isinstance(frame, dict) for frame in frames):
            raise InputError(f"{where}: {_NO_FORM}")
        # Only what describes the camera itself counts, not where it stood.
        cameras = [(frame.get("cam_K"), frame.get("depth_scale")) for frame in frames]
        if any(camera != cameras[0] for camera in cameras):
            raise InputError(f"{where}: the frames have several cameras; write one into a file")
        return dict(frames[0])
    for name in _WRAPPERS:
        if isinstance(content.get(name), dict):
            return _one_camera(content[name], where)
    return {str(name): value for name, value in content.items()}


def _camera(content: Mapping[str, Any], where: str) -> Camera:
    keys = next((keys for keys in _FORMS if content.keys() >= {*keys}), None)
    if keys is None:
        raise InputError(f"{where}: {_NO_FORM}")
    values: Any = [content[key] for key in keys]
    if len(keys) == 1:
        stated, values = values[0], _data(values[0])
        if isinstance(stated, dict) and [stated.get(key, 3) for key in ("rows", "cols")] != [3, 3]:
            raise InputError(f"{where}: {keys[0]} must have 3 rows and 3 cols")
    matrix = _matrix(values, where, by_columns=keys == ("intrinsic_matrix",))
    distortion, fisheye = _distortion(content, where)
    scale = content.get("depth_scale")
    if scale is not None and (type(scale) not in (int, float) or not 0 < scale < _LONGEST_UNIT):
        raise InputError(f"{where}: depth_scale must be a positive number, not {scale!r}")
    depth_scale = None if scale is None else float(scale)
    return Camera(matrix, _size(content, where), distortion, fisheye, depth_scale)


def _data(values: Any) -> Any:
    """The numbers of a matrix that ROS and OpenCV write as rows, cols and data."""
    return values.get("data") if isinstance(values, dict) else values


def _size(content: Mapping[str, Any], where: str) -> tuple[int, int] | None:
    for names in _SIZES:
        sides: list[Any] = [content.get(name) for name in names]
        if all(type(side) is int and 0 < side < _LARGEST for side in sides):
            return sides[0], sides[1]
        if sides != [None, None]:
            raise InputError(f"{where}: {' and '.join(names)} are {sides}: give pixels")
    return None


def _distortion(content: Mapping[str, Any], where: str) -> tuple[tuple[float, ...], bool]:
    """Coefficients and whether they are a fisheye's; none if all are 0."""
    values = next((_data(content[name]) for name in _DISTORTION if name in content), None)
    try:
        coefficients = tuple(float(value) for value in np.ravel([] if values is None else values))
    except (TypeError, ValueError, OverflowError) as error:
        raise InputError(f"{where}: the distortion must be numbers, not {values!r}") from error
    if not any(coefficients):
        return (), False
    if not all(abs(value) < _MOST_BENT for value in coefficients):
        raise InputError(f"{where}: no lens has a distortion of {values}")
    stated = content.get("distortion_model", content.get("model", ""))
    name = re.sub(r"[\s-]+", "_", str(stated).lower().removeprefix("distortion.")).strip("_")
    if name not in _MODELS:
        raise InputError(
            f"{where}: distortion model {stated!r} cannot be undone here: rectify the images first "
            "and give the intrinsics of the rectified ones, without distortion"
        )
    counts = _MODELS[name]
    if not counts:
        return (), False
    if len(coefficients) not in counts:
        raise InputError(
            f"{where}: {len(coefficients)} distortion coefficients: it must be "
            f"{' or '.join(map(str, counts))}"
        )
    fisheye = counts == _FISHEYE
    return coefficients[:4] if fisheye else coefficients, fisheye


def _matrix(values: Any, where: str, by_columns: bool = False) -> CameraMatrix:
    try:
        flat = np.ravel(values).tolist() if isinstance(values, list | tuple) else []
    except ValueError:  # rows of different lengths
        flat = []
    if len(flat) == 4:
        fx, fy, cx, cy = flat
        flat = [fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0]
    if len(flat) != 9:
        raise InputError(f"{where}: {values!r} is neither nine numbers of K nor [fx,fy,cx,cy]")
    if by_columns and len(values) == 9:  # people who write rows as lists write rows
        flat = [flat[3 * column + row] for row in range(3) for column in range(3)]
    return camera_matrix(flat, where)


def check_size(camera: Camera, shape: tuple[int, ...], image: Path, key: str) -> None:
    """Raise InputError or DataError unless intrinsics can be those of an image (h, w)."""
    height, width = shape[:2]
    if camera.size is not None and camera.size != (width, height):
        scale = width / camera.size[0]
        raise InputError(
            f"{key} are those of images of {camera.size[0]}x{camera.size[1]}, but {image} is "
            f"{width}x{height}: take those of the stream that the images come from, or, for a "
            f"picture made smaller or larger, multiply fx, fy, cx and cy by {scale:g}"
        )
    camera_matrix(camera.matrix, key, (width, height))


def undistorted(image: np.ndarray[Any, Any], camera: Camera, nearest: bool) -> np.ndarray[Any, Any]:
    """The image that a camera with the same matrix and no distortion would have made.

    Depth must be taken from the `nearest` pixel: a mean over an edge is a place where nothing is.
    What the camera did not see is 0.
    """
    if not camera.distortion:
        return image
    height, width = image.shape[:2]
    values = tuple(camera.matrix.ravel())
    across, down = _undistortion(values, camera.distortion, camera.fisheye, width, height)
    how = cv2.INTER_NEAREST if nearest else cv2.INTER_LINEAR
    return np.asarray(cv2.remap(image, across, down, how, borderValue=0))


@lru_cache(maxsize=4)
def _undistortion(
    values: tuple[float, ...], distortion: tuple[float, ...], fisheye: bool, width: int, height: int
) -> tuple[np.ndarray[Any, Any], np.ndarray[Any, Any]]:
    matrix, coefficients = np.array(values).reshape(3, 3), np.array(distortion)
    make = cv2.fisheye.initUndistortRectifyMap if fisheye else cv2.initUndistortRectifyMap
    across, down = make(matrix, coefficients, np.eye(3), matrix, (width, height), cv2.CV_32FC1)
    seen = (across >= 0) & (across < width) & (down >= 0) & (down < height)
    if seen.mean() < _LEAST_SEEN:
        raise InputError(f"no lens has a distortion of {list(distortion)}: nearly nothing is seen")
    return across, down


def resampled_depth(
    depth: Float[np.ndarray, "a b"],
    camera: Camera,
    color_matrix: CameraMatrix,
    shape: tuple[int, int],
) -> Image:
    """Depth at the pixels of a colour image (h, w), for two cameras that stand in one place.

    Each colour pixel takes the value of the nearest depth pixel on its viewing ray, 0 where the
    depth camera does not look.
    """
    places = []
    for axis, count in ((1, shape[0]), (0, shape[1])):
        focal, center = color_matrix[axis, axis], color_matrix[axis, 2]
        rays = (np.arange(count) - center) / focal
        places.append(np.rint(rays * camera.matrix[axis, axis] + camera.matrix[axis, 2]))
    rows, columns = places[0].astype(int)[:, None], places[1].astype(int)
    seen = (rows >= 0) & (rows < depth.shape[0]) & (columns >= 0) & (columns < depth.shape[1])
    last = np.array(depth.shape) - 1
    taken = depth[np.clip(rows, 0, last[0]), np.clip(columns, 0, last[1])]
    return np.asarray(np.where(seen, taken, 0).astype(depth.dtype))


def resized_camera(matrix: CameraMatrix, scale: float, size: tuple[int, int]) -> Camera:
    """The camera of an image `scale` times as large as that of `matrix`; `size` (width, height)."""
    resized = matrix.copy()
    resized[:2] *= scale
    # The centre of the first pixel lies half a pixel from the border, whatever the pixel's size.
    resized[:2, 2] += (scale - 1.0) / 2.0
    return Camera(resized, size)
