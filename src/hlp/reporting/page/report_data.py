"""What a run keeps for its page beside its results, and how the page lists its targets.

<run's folder>/report/index.json      `ReportData`
<run's folder>/report/*.jpg           a picture of each of these targets
"""

import math
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
from hlp.reporting.comparison import ScoredTarget
from hlp.reporting.figures import in_base64
from hlp.reporting.figures.panels import SeenTarget, write_picture
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
class Wires(Stored):
    """An object in the 3D view: its mesh in mm."""

    diameter_mm: Positive
    vertices: list[Any]
    edges: list[Any]


@dataclass(frozen=True)
class Scene(Stored):
    """A target in the 3D view.

    `points` (int16, tenths of a mm from the `middle`) and `colors` (uint8) are in base64; `middle`,
    `truth` and `estimate` (16 numbers row by row) are in mm.
    """

    key: tuple[Id, Id, Id, Id]
    picture: str
    middle: Annotated[list[float], Len(3, 3)]
    points: str
    colors: str
    truth: Annotated[list[float], Len(16, 16)]
    estimate: Annotated[list[float], Len(16, 16)] | None


@dataclass(frozen=True)
class ReportData(Stored):
    """Objects by name, and targets; empty for runs that kept none."""

    objects: dict[str, Wires] = field(default_factory=dict)
    targets: list[Scene] = field(default_factory=list)

    @classmethod
    def read(cls, run: Path) -> "ReportData":
        """What a run has kept for its page. Raises DataError for a broken index."""
        path = run / FOLDER / _INDEX
        return read_as(path, cls) if path.is_file() else cls()

    def write(self, run: Path) -> None:
        """Write it where `read` finds it."""
        write_json(run / FOLDER / _INDEX, asdict(self))

    @property
    def scenes(self) -> dict[TargetKey, Scene]:
        """The targets by key."""
        return {target.key: target for target in self.targets}


def picture_path(run: Path, target: Scene) -> Path | None:
    """A target's picture; None where there is none, or the file is no JPEG.

    Raises DataError where the index names a file outside of the report's folder.
    """
    path = inside(run / FOLDER, target.picture)
    if not path.is_file():
        return None
    with path.open("rb") as stream:
        return path if stream.read(len(_JPEG)) == _JPEG else None


def keep_target(run: Path, key: TargetKey, picture: Rgb, seen: SeenTarget) -> Scene:
    """Write a target's picture (RGB); its true and found poses, and what is around them."""
    true, found = seen.truth.pose_cam_obj, seen.pose
    scene, image, object_id, instance = key
    name = f"{scene:06d}_{image:06d}_{object_id}_{instance}.jpg"
    size = (_WIDTH, round(picture.shape[0] * _WIDTH / picture.shape[1]))
    small = cv2.resize(picture, size, interpolation=cv2.INTER_AREA)
    write_picture(run / FOLDER / name, np.asarray(small, dtype=np.uint8), _QUALITY)
    poses = [true] if found is None else [true, found]
    points, colors = scene_around(seen.frame, seen.model, poses)
    middle = MILLIMETRES_PER_METRE * true[:3, 3]
    places = np.rint(_UNITS * (MILLIMETRES_PER_METRE * points - middle))
    return Scene(
        key=key,
        picture=name,
        middle=np.round(middle, 2).tolist(),
        points=in_base64(np.clip(places, -32768, 32767).astype("<i2").tobytes()),
        colors=in_base64(colors.tobytes()),
        truth=_motion(true),
        estimate=None if found is None else _motion(found),
    )


def wires_of(model: ObjectModel) -> Wires:
    """The edges of an object's coarse mesh."""
    mesh = decimate(model.proxy, _FACES)
    sides = mesh.faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2)
    return Wires(
        diameter_mm=round(MILLIMETRES_PER_METRE * model.diameter, 3),
        vertices=np.round(MILLIMETRES_PER_METRE * mesh.vertices, 1).tolist(),
        edges=np.unique(np.sort(sides, axis=1), axis=0).tolist(),
    )


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


COLUMNS = (
    "scene", "image", "object", "", "verdict", "cause", "visible", "ADD(-S) mm", "rotation °",
    "shift mm", "score",
)  # fmt: skip
DIGITS = (0, 0, 0, 0, 0, 0, 2, 1, 1, 1, 3)
"""Columns of the list of targets, and the digits of each."""


def target_rows(targets: Mapping[TargetKey, ScoredTarget]) -> list[list[str | float | None]]:
    """A row a target in the order of `COLUMNS`; the fourth cell is its key."""
    rows = []
    for key, target in targets.items():
        score = target.score
        verdict = "right" if score.add_correct else "wrong" if score.found else "not found"
        named = (score.scene_id, score.frame_id, target.name, _name(key), verdict)
        numbers = (
            score.visible_fraction,
            MILLIMETRES_PER_METRE * score.add_error,
            math.degrees(score.rotation_error),
            MILLIMETRES_PER_METRE * score.translation_error,
            score.score,
        )
        # JSON has neither nan nor inf.
        finite = (round(value, 3) if math.isfinite(value) else None for value in numbers)
        rows.append([*named, score.cause.replace("_", " "), *finite])
    return rows


def target_pictures(
    folder: Path, kept: ReportData, scores: Mapping[TargetKey, ScoredTarget], room: int
) -> dict[str, str]:
    """JPEGs in base64 by the targets' names, as many as there is room (bytes) for, misses first."""
    right = {key for key, target in scores.items() if target.correct("add")}
    pictures = {}
    for scene in sorted(kept.targets, key=lambda scene: scene.key in right):
        path = picture_path(folder, scene)
        room -= 0 if path is None else path.stat().st_size
        if path is not None and room >= 0:
            pictures[_name(scene.key)] = in_base64(path.read_bytes())
    return pictures


def target_scenes(
    kept: ReportData, targets: Mapping[TargetKey, ScoredTarget]
) -> dict[str, dict[str, Any]]:
    """Models by object, and what is around each target that has a picture."""
    return {
        "models": {name: asdict(wires) for name, wires in kept.objects.items()},
        "targets": {
            _name(key): {**asdict(scene), "object": targets[key].name}
            for key, scene in kept.scenes.items()
            if key in targets
        },
    }


def _name(key: TargetKey) -> str:
    return "_".join(map(str, key))
