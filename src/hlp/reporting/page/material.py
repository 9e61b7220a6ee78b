"""What a run keeps for its page beside its results: pictures and scenes of some targets.

<run's folder>/report/index.json      objects and targets, see `PageMaterial`
<run's folder>/report/*.jpg           a picture of each of these targets
"""

import base64
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from jaxtyping import Float, Int, UInt8

from hlp.errors import DataError
from hlp.files import read_json, replaced, write_json
from hlp.records import MILLIMETRES_PER_METRE
from hlp.results.summary_file import TargetKey

FOLDER = "report"
_INDEX = "index.json"
_JPEG = b"\xff\xd8\xff"  # how every such file begins
_QUALITY = 72
_UNITS = 10.0  # of a point's coordinates in a millimetre


@dataclass(frozen=True)
class PageObject:
    """An object's diameter (m) and a coarse mesh (m, object coordinates) as its edges."""

    diameter: float
    vertices: Float[np.ndarray, "v 3"]
    edges: Int[np.ndarray, "e 2"]


@dataclass(frozen=True)
class PageTarget:
    """A target with its picture (RGB), and the coloured points of the scene around it (m, camera).

    `estimate` is the pose that was found, or None.
    """

    key: TargetKey
    picture: UInt8[np.ndarray, "h w 3"]
    points: Float[np.ndarray, "n 3"]
    colors: UInt8[np.ndarray, "n 3"]
    truth: Float[np.ndarray, "4 4"]
    estimate: Float[np.ndarray, "4 4"] | None


@dataclass(frozen=True)
class PageMaterial:
    """The material as plain values for the page's script; empty for runs that kept none.

    `objects` by name: `diameter_mm`, `vertices` (mm), `edges`. `targets` by key: name of the
    `picture`, and the scene: its `middle` (mm), `points` (int16, tenths of a mm from there) and
    `colors` (uint8) in base64, `truth` and `estimate` (16 numbers row by row, mm).
    """

    objects: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    targets: Mapping[TargetKey, Mapping[str, Any]] = field(default_factory=dict)

    @property
    def diameters_mm(self) -> dict[str, float]:
        """Diameter of each object by name."""
        return {name: float(each["diameter_mm"]) for name, each in self.objects.items()}


def write_material(
    run: Path, objects: Mapping[str, PageObject], targets: Sequence[PageTarget]
) -> None:
    """Write the material of a run's page into its folder, in place of what was there.

    Raises OSError where it cannot be written.
    """
    folder = run / FOLDER
    for old in folder.glob("*.jpg"):
        old.unlink()
    index = {
        "objects": {
            name: {
                "diameter_mm": round(MILLIMETRES_PER_METRE * each.diameter, 3),
                "vertices": np.round(MILLIMETRES_PER_METRE * each.vertices, 1).tolist(),
                "edges": each.edges.tolist(),
            }
            for name, each in objects.items()
        },
        "targets": [_write_target(folder, each) for each in targets],
    }
    write_json(folder / _INDEX, index)


def read_material(run: Path) -> PageMaterial:
    """The material of a run's page; empty where the run has kept none.

    Raises DataError for a broken index.
    """
    path = run / FOLDER / _INDEX
    if not path.is_file():
        return PageMaterial()
    index = read_json(path)
    try:
        keys = [tuple(int(part) for part in each["key"]) for each in index["targets"]]
        targets = {(a, b, c, d): t for (a, b, c, d), t in zip(keys, index["targets"], strict=True)}
        return PageMaterial(dict(index["objects"]), targets)
    except (KeyError, TypeError, ValueError) as error:
        raise DataError(f"{path} is no material of a page ({error!r})") from error


def picture_path(run: Path, target: Mapping[str, Any]) -> Path | None:
    """A target's picture, if it is a JPEG within the material's folder: runs come from anywhere.

    None where it is absent, and where the index or a link names another file.
    """
    name = str(target["picture"])
    path = run / FOLDER / name
    if name != Path(name).name or path.is_symlink() or not path.is_file():
        return None
    with path.open("rb") as stream:
        return path if stream.read(len(_JPEG)) == _JPEG else None


def edges_of(faces: Int[np.ndarray, "f 3"]) -> Int[np.ndarray, "e 2"]:
    """Every edge of some triangles once."""
    sides = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    return np.unique(np.sort(sides, axis=1), axis=0)


def _write_target(folder: Path, target: PageTarget) -> dict[str, Any]:
    scene, frame, object_id, instance = target.key
    name = f"{scene:06d}_{frame:06d}_{object_id}_{instance}.jpg"
    bgr = cv2.cvtColor(target.picture, cv2.COLOR_RGB2BGR)
    with replaced(folder / name) as stream:
        stream.write(cv2.imencode(".jpg", bgr, [cv2.IMWRITE_JPEG_QUALITY, _QUALITY])[1].tobytes())
    middle = MILLIMETRES_PER_METRE * target.truth[:3, 3]
    offsets = _UNITS * (MILLIMETRES_PER_METRE * target.points - middle)
    places = np.clip(np.rint(offsets), -32768, 32767).astype("<i2")
    return {
        "key": list(target.key),
        "picture": name,
        "middle": np.round(middle, 2).tolist(),
        "points": _text(places),
        "colors": _text(target.colors),
        "truth": _motion(target.truth),
        "estimate": None if target.estimate is None else _motion(target.estimate),
    }


def _motion(pose: Float[np.ndarray, "4 4"]) -> list[float]:
    millimetres = np.array(pose, dtype=np.float64)
    millimetres[:3, 3] *= MILLIMETRES_PER_METRE
    return [round(float(value), 5) for value in millimetres.ravel()]


def _text(values: np.ndarray) -> str:
    return base64.b64encode(np.ascontiguousarray(values).tobytes()).decode("ascii")
