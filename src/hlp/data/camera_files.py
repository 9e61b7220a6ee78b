"""Intrinsics in the forms in which cameras, ROS, Open3D and OpenCV write them."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import accumulate
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from jaxtyping import Float

from hlp.data.images import camera_matrix
from hlp.errors import DataError, InputError, MissingFileError
from hlp.schemas.reading import parse_json

FISHEYE = "fisheye"
_MOST_BYTES = 64 * 1024**2
_DEEPEST = 20  # brackets within brackets
_LONGEST_UNIT = 1e6  # mm
_PLAIN, _PINHOLE = "none", "pinhole"
# Names of distortion models: ROS's, RealSense's and OpenCV's.
_MODELS = {
    "plumb_bob": _PINHOLE, "rational_polynomial": _PINHOLE, "brown_conrady": _PINHOLE,
    "modified_brown_conrady": _PINHOLE, "radtan": _PINHOLE, "pinhole": _PINHOLE, "": _PINHOLE,
    "equidistant": FISHEYE, "fisheye": FISHEYE, "kannala_brandt4": FISHEYE, "none": _PLAIN,
}  # fmt: skip
_PINHOLE_NUMBERS = (4, 5, 8, 12, 14)  # of coefficients, as OpenCV takes them
_FISHEYE_NUMBERS = (4, 5)  # RealSense writes five, the last one 0
_FORMS = (
    "cam_K (nine numbers), nor fx, fy, cx and cy, nor what ROS (K or camera_matrix), RealSense "
    "(ppx, ppy) or Open3D (intrinsic_matrix) write"
)


@dataclass(frozen=True)
class Camera:
    """Intrinsics of a camera, as a file states them.

    `matrix` in pixels; `size` (width, height) of its images, None if not stated. `distortion` are
    OpenCV's coefficients (k1, k2, p1, p2, k3, …; of a `fisheye` k1 … k4), empty without distortion.
    `depth_scale` is mm per unit of the depth images, None if not stated.
    """

    matrix: Float[np.ndarray, "3 3"]
    size: tuple[int, int] | None = None
    distortion: tuple[float, ...] = ()
    fisheye: bool = False
    depth_scale: float | None = None


def read_camera(given: str | Sequence[float], key: str = "intrinsics") -> Camera:
    """The camera in a file, or of four (fx, fy, cx, cy) or nine numbers (px).

    The file may be JSON, YAML or text: `cam_K` or fx, fy, cx, cy; BOP's scene_camera.json if all
    frames have one camera; a RealSense's intrinsics; ROS's camera_info; Open3D's; OpenCV's; or the
    numbers of a 3×3 matrix. Raises MissingFileError, and InputError for anything else; both name
    `key`.
    """
    if not isinstance(given, str):
        return Camera(_matrix(list(given), key))
    path = Path(given)
    if not path.is_file():
        raise MissingFileError(f"{key} is no file: {path} (set {key}=FILE or {key}=[fx,fy,cx,cy])")
    where = f"{key}, {path}"
    content = _parsed(path, where)
    if isinstance(content, list):
        return Camera(_matrix(content, where))
    if isinstance(content, dict):
        return _camera(_one_camera(content, where), where)
    raise InputError(f"{where}: it holds neither keys nor nine or four numbers")


def _parsed(path: Path, where: str) -> Any:
    """Numbers of a plain text as a list; JSON and YAML as what they say."""
    if (size := path.stat().st_size) > _MOST_BYTES:
        raise InputError(f"{where} has {size} bytes: intrinsics have {_MOST_BYTES} at most")
    try:
        text = path.read_text(encoding="utf-8-sig")
    except UnicodeDecodeError as error:
        raise InputError(f"{where} is no text: give JSON, YAML or nine numbers") from error
    words = re.split(r"[\s,;\[\]]+", text.strip(" \t\r\n,;[]"))
    try:
        return [float(word) for word in words]
    except ValueError:
        pass
    try:
        if path.suffix.lower() == ".json":
            return parse_json(text, where)
        # OpenCV writes a first line and tags that other readers of YAML do not know.
        plain = re.sub(r"^%YAML.*\n", "", text).replace("!!opencv-matrix", "")
        if _nesting(plain) > _DEEPEST:  # the parser takes 18 s for five thousand brackets
            raise InputError(f"{where} is nested too deeply: no intrinsics are")
        if any(isinstance(each, yaml.AliasEvent) for each in yaml.parse(plain)):
            raise InputError(f"{where} refers to itself (*name): write the numbers out")
        documents = list(yaml.safe_load_all(plain))  # `rostopic echo` ends with ---
        return documents[0] if documents else None
    except RecursionError as error:
        raise InputError(f"{where} is nested too deeply: no intrinsics are") from error
    except DataError as error:
        raise InputError(str(error)) from error
    except InputError:
        raise
    except (ValueError, yaml.YAMLError) as error:
        first = str(error).splitlines()[0]
        raise InputError(f"{where} is neither JSON, YAML nor nine numbers: {first}") from error


def _nesting(text: str) -> int:
    """How many brackets are open at once at most, whatever is in quotes."""
    signs = [1 if each in "[{" else -1 for each in re.findall(r"[\[\]{}]", text)]
    return max(accumulate(signs), default=0)


def _one_camera(content: dict[Any, Any], where: str) -> Mapping[str, Any]:
    """The mapping that holds the camera, without what is wrapped around it."""
    frames = [each for name, each in content.items() if str(name).isdecimal()]
    if frames and len(frames) == len(content):  # scene_camera.json: a camera for each frame
        if any(_of_camera(each) != _of_camera(frames[0]) for each in frames):
            raise InputError(f"{where}: the frames have several cameras; write one into a file")
        return _mapping(frames[0], where)
    for name in ("intrinsic", "intrinsics", "camera_info", "color"):
        if isinstance(content.get(name), dict):
            return _one_camera(content[name], where)
    return {str(name): value for name, value in content.items()}


def _of_camera(frame: Any) -> Any:
    """What describes the camera itself in an entry of scene_camera.json, not where it stood."""
    kept = ("cam_K", "depth_scale")
    return {key: frame.get(key) for key in kept} if isinstance(frame, dict) else frame


def _mapping(content: Any, where: str) -> Mapping[str, Any]:
    if not isinstance(content, dict):
        raise InputError(f"{where}: no {_FORMS}")
    return content


def _camera(content: Mapping[str, Any], where: str) -> Camera:
    if "cam_K" in content:
        values = content["cam_K"]
    elif {"fx", "fy", "ppx", "ppy"} <= content.keys():
        values = [content[name] for name in ("fx", "fy", "ppx", "ppy")]
    elif {"fx", "fy", "cx", "cy"} <= content.keys():
        values = [content[name] for name in ("fx", "fy", "cx", "cy")]
    elif "intrinsic_matrix" in content:
        values = _transposed(content["intrinsic_matrix"])
    else:
        named = (content[name] for name in ("camera_matrix", "K", "k") if name in content)
        values = _data(next(named, None))
        if values is None:
            raise InputError(f"{where}: no {_FORMS}")
    distortion, fisheye = _distortion(content, where)
    scale = content.get("depth_scale")
    if scale is not None and (not isinstance(scale, int | float) or not 0 < scale < _LONGEST_UNIT):
        raise InputError(f"{where}: depth_scale must be a positive number, not {scale!r}")
    return Camera(
        _matrix(values, where),
        _size(content, where),
        distortion,
        fisheye,
        None if scale is None else float(scale),
    )


def _transposed(values: Any) -> Any:
    """Open3D writes its matrix column by column."""
    return [values[i] for i in (0, 3, 6, 1, 4, 7, 2, 5, 8)] if _is_flat(values, 9) else values


def _is_flat(values: Any, count: int) -> bool:
    return isinstance(values, list) and len(values) == count


def _data(values: Any) -> Any:
    """The numbers of a matrix that ROS and OpenCV write as rows, cols and data."""
    return values.get("data") if isinstance(values, dict) else values


def _size(content: Mapping[str, Any], where: str) -> tuple[int, int] | None:
    for names in (("width", "height"), ("image_width", "image_height")):
        size = [content.get(name) for name in names]
        if size != [None, None]:
            if not all(isinstance(each, int) and each > 0 for each in size):
                raise InputError(f"{where}: {names[0]} and {names[1]} are {size}: give pixels")
            return (int(str(size[0])), int(str(size[1])))
    return None


def _distortion(content: Mapping[str, Any], where: str) -> tuple[tuple[float, ...], bool]:
    """Coefficients and whether they are a fisheye's; none if all are 0."""
    names = ("coeffs", "distortion_coefficients", "D", "d", "dist_coeffs", "distortion")
    values = next((_data(content[name]) for name in names if name in content), None)
    try:
        coefficients = tuple(float(each) for each in np.ravel([] if values is None else values))
    except (TypeError, ValueError, OverflowError) as error:
        raise InputError(f"{where}: the distortion must be numbers, not {values!r}") from error
    if not np.isfinite(coefficients).all():
        raise InputError(f"{where}: the distortion must be finite, not {list(coefficients)}")
    if not any(coefficients):
        return (), False
    stated = content.get("distortion_model", content.get("model", ""))
    name = re.sub(r"[\s-]+", "_", str(stated).lower().removeprefix("distortion.")).strip("_")
    model = _MODELS.get(name)
    if model is None:
        raise InputError(
            f"{where}: distortion model {stated!r} cannot be undone here: rectify the images first "
            "and give the intrinsics of the rectified ones, without distortion"
        )
    if model == _PLAIN:
        return (), False
    fisheye = model == FISHEYE
    numbers = _FISHEYE_NUMBERS if fisheye else _PINHOLE_NUMBERS
    if len(coefficients) not in numbers:
        expected = " or ".join(map(str, numbers))
        raise InputError(
            f"{where}: {len(coefficients)} distortion coefficients: it must be {expected}"
        )
    return coefficients[:4] if fisheye else coefficients, fisheye


def _matrix(values: Any, where: str) -> Float[np.ndarray, "3 3"]:
    try:
        flat = np.ravel(values).tolist() if isinstance(values, list | tuple) else []
    except ValueError:  # rows of different lengths
        flat = []
    if len(flat) == 4:
        flat = [flat[0], 0.0, flat[2], 0.0, flat[1], flat[3], 0.0, 0.0, 1.0]
    if len(flat) != 9:
        raise InputError(f"{where}: {values!r} is neither nine numbers of K nor [fx,fy,cx,cy]")
    matrix = camera_matrix(flat, Path(where))
    if not np.array_equal(matrix[[1, 2, 2, 2], [0, 0, 1, 2]], [0.0, 0.0, 0.0, 1.0]):
        raise InputError(f"{where}: {flat} is no camera matrix, row by row: fx 0 cx 0 fy cy 0 0 1")
    return matrix
