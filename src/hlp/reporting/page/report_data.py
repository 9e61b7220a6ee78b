"""What a run keeps for its page beside its results: pictures and scenes of some targets.

<run's folder>/report/index.json      objects and targets, see `ReportData`
<run's folder>/report/*.jpg           a picture of each of these targets
"""

import base64
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Annotated, Any

import cv2
import numpy as np
from annotated_types import Len
from jaxtyping import Float, UInt8

from hlp.arrays import Pose, Rgb
from hlp.files import write_json
from hlp.folders import inside
from hlp.geometry import back_project, transform
from hlp.objects.meshes import decimate
from hlp.records import MILLIMETRES_PER_METRE, Frame, ObjectModel
from hlp.reporting.figures.panels import write_picture
from hlp.results.recalls import TargetKey
from hlp.schemas import Id
from hlp.settings import Positive, Stored, read_as

FOLDER, PANELS, STAGES = "report", "panels", "stages"
"""Folders of a run's pictures: of targets on its page, of some frames, of the stages."""
CAPTIONS = {
    "viewpoints": "Views: where they are rendered from",
    "views": "Views: some of those rendered of each object",
    "training_windows": "Region: what the classifier is trained on",
    "nearest_entries": "Votes: patches of images and the most similar codebook entries",
    "swarm_costs": "Refinement: costs of the poses that the swarm tries",
    "missed_swarm_costs": "Refinement: the same for targets that were missed",
}
"""What each picture of the stages shows, by its name without ending, in the order of the stages."""
_INDEX = "index.json"
_JPEG = b"\xff\xd8\xff"  # how every such file begins
_WIDTH, _QUALITY = 1280, 72  # px of a picture; of its JPEG
_FACES = 300  # of a model in the 3D view
_POINTS = 2500  # of a scene in the 3D view
_AROUND = 1.1  # diameters from the object's true and found places that are in the 3D view
_UNITS = 10.0  # of a point's coordinates in a millimetre


def drawn_stages(run: Path) -> dict[str, Path]:
    """Files of the pictures that a run has drawn, by their captions, in the order of the stages."""
    files = {words: run / STAGES / f"{name}.jpg" for name, words in CAPTIONS.items()}
    return {words: path for words, path in files.items() if path.is_file()}


@dataclass(frozen=True)
class _Object(Stored):
    """A model in the 3D view."""

    diameter_mm: Positive
    vertices: list[Any]
    edges: list[Any]


@dataclass(frozen=True)
class _Target(Stored):
    """A target in the 3D view."""

    key: tuple[Id, Id, Id, Id]
    picture: str
    middle: Annotated[list[float], Len(3, 3)]
    points: str
    colors: str
    truth: Annotated[list[float], Len(16, 16)]
    estimate: Annotated[list[float], Len(16, 16)] | None


@dataclass(frozen=True)
class _Index(Stored):
    """What index.json must say."""

    objects: dict[str, _Object]
    targets: list[_Target]


@dataclass(frozen=True)
class ReportData:
    """Plain values for the page's script; empty for runs that kept none.

    `objects` by name: `diameter_mm`, `vertices` (mm), `edges`. `targets` by key: name of the
    `picture`, and the scene: its `middle` (mm), `points` (int16, tenths of a mm from there) and
    `colors` (uint8) in base64, `truth` and `estimate` (16 numbers row by row, mm).
    """

    objects: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    targets: Mapping[TargetKey, Mapping[str, Any]] = field(default_factory=dict)

    @property
    def diameters_mm(self) -> dict[str, float]:
        """Diameter of each object by name."""
        return {name: float(values["diameter_mm"]) for name, values in self.objects.items()}


def read_report_data(run: Path) -> ReportData:
    """What a run has kept for its page; empty where that is nothing.

    Raises DataError for a broken index.
    """
    path = run / FOLDER / _INDEX
    if not path.is_file():
        return ReportData()
    index = read_as(path, _Index)
    objects = {name: asdict(kept) for name, kept in index.objects.items()}
    return ReportData(objects, {target.key: asdict(target) for target in index.targets})


def picture_path(run: Path, target: Mapping[str, Any]) -> Path | None:
    """A target's picture; None where there is none, or the file is no JPEG.

    Raises DataError where the index names a file outside of the report's folder.
    """
    path = inside(run / FOLDER, str(target["picture"]))
    if not path.is_file():
        return None
    with path.open("rb") as stream:
        return path if stream.read(len(_JPEG)) == _JPEG else None


class ReportDataWriter:
    """Writes what a run keeps for its page into its folder, in place of what was there.

    Raises OSError where it cannot be written.
    """

    def __init__(self, run: Path) -> None:
        self._folder = run / FOLDER
        self._targets: list[dict[str, Any]] = []
        for old in self._folder.glob("*.jpg"):
            old.unlink()

    def add_target(
        self,
        key: TargetKey,
        picture: Rgb,
        frame: Frame,
        model: ObjectModel,
        poses: tuple[Pose, Pose | None],
    ) -> None:
        """Keep a target's picture (RGB), its true and found poses, and what is around them."""
        true, found = poses
        scene, image, object_id, instance = key
        name = f"{scene:06d}_{image:06d}_{object_id}_{instance}.jpg"
        size = (_WIDTH, round(picture.shape[0] * _WIDTH / picture.shape[1]))
        small = cv2.resize(picture, size, interpolation=cv2.INTER_AREA)
        write_picture(self._folder / name, np.asarray(small, dtype=np.uint8), _QUALITY)
        points, colors = scene_around(frame, model, [true] if found is None else [true, found])
        middle = MILLIMETRES_PER_METRE * true[:3, 3]
        offsets = _UNITS * (MILLIMETRES_PER_METRE * points - middle)
        places = np.clip(np.rint(offsets), -32768, 32767).astype("<i2")
        self._targets.append(
            {
                "key": list(key),
                "picture": name,
                "middle": np.round(middle, 2).tolist(),
                "points": _text(places),
                "colors": _text(colors),
                "truth": _motion(true),
                "estimate": None if found is None else _motion(found),
            }
        )

    def write(self, models: Sequence[ObjectModel]) -> None:
        """Write the index, with the diameter and a coarse mesh of each object."""
        objects = {}
        for model in models:
            mesh = decimate(model.proxy, _FACES)
            faces = mesh.faces
            sides = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
            objects[model.name] = {
                "diameter_mm": round(MILLIMETRES_PER_METRE * model.diameter, 3),
                "vertices": np.round(MILLIMETRES_PER_METRE * mesh.vertices, 1).tolist(),
                "edges": np.unique(np.sort(sides, axis=1), axis=0).tolist(),
            }
        write_json(self._folder / _INDEX, {"objects": objects, "targets": self._targets})


def scene_around(
    frame: Frame, model: ObjectModel, poses: Sequence[Pose]
) -> tuple[Float[np.ndarray, "n 3"], UInt8[np.ndarray, "n 3"]]:
    """Coloured points (m) near the object in one of the poses: a random but repeatable choice."""
    y, x = np.nonzero(frame.depth > 0)
    pixels = np.stack([x, y], axis=1).astype(np.float64)
    points = back_project(pixels, frame.depth[y, x], frame.camera_matrix)
    near = np.zeros(len(points), dtype=bool)
    for pose in poses:
        center = transform(pose, model.centroid[None])[0]
        near |= ((points - center) ** 2).sum(axis=-1) < (_AROUND * model.diameter) ** 2
    chosen = np.flatnonzero(near)
    if len(chosen) > _POINTS:
        chosen = np.random.default_rng(0).choice(chosen, _POINTS, replace=False)
    return points[chosen], frame.rgb[y[chosen], x[chosen]]


def _motion(pose: Pose) -> list[float]:
    millimetres = np.array(pose, dtype=np.float64)
    millimetres[:3, 3] *= MILLIMETRES_PER_METRE
    return [round(float(value), 5) for value in millimetres.ravel()]


def _text(values: np.ndarray) -> str:
    return base64.b64encode(np.ascontiguousarray(values).tobytes()).decode("ascii")
