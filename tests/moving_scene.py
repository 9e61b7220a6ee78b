"""A simulated RGB-D camera: demo objects that move above a table, with exact poses."""

from collections.abc import Iterator, Mapping, Sequence

import numpy as np
import trimesh

from hlp.evaluation.errors import add_s
from hlp.geometry import rigid
from hlp.records import CameraImage, ObjectModel
from hlp.rendering.rasterizer import render_scene
from hlp.rendering.shading import FRONTAL_LIGHT
from refinement_scene import as_mesh, posed

CAMERA = np.array([[286.2, 0.0, 162.6], [0.0, 286.8, 121.0], [0.0, 0.0, 1.0]])
SHAPE = (240, 320)
TURN = trimesh.transformations.rotation_matrix
TABLE = as_mesh(trimesh.creation.box((1.2, 1.2, 0.01)), (110, 105, 100))
TABLE_POSE = rigid(TURN(2.2, [1, 0, 0])[:3, :3], np.array([0.0, 0.1, 0.95]))


def path(
    model: ObjectModel,
    steps: int,
    start: Sequence[float],
    step_mm: float = 4.0,
    turn_deg: float = 2.0,
) -> np.ndarray:
    """Poses (n, 4, 4): the centroid moves along x from `start` (m), turning about one axis."""
    upright = TURN(2.2, [1, 0, 0])[:3, :3]
    rotations = [TURN(np.deg2rad(turn_deg) * i + 0.5, [0.2, 0.3, 1])[:3, :3] for i in range(steps)]
    centres = np.array(start) + np.arange(steps)[:, None] * np.array([step_mm / 1000.0, 0.0, 0.0])
    poses = zip(rotations, centres, strict=True)
    return np.stack([posed(model, upright @ turn, centre) for turn, centre in poses])


def is_right(pose: np.ndarray, true: np.ndarray, model: ObjectModel) -> bool:
    """Whether ADD-S is less than a tenth of the diameter."""
    return add_s(pose, true, model.mesh.vertices) < 0.1 * model.diameter


def picture(
    parts: Sequence[tuple[ObjectModel, np.ndarray]], seed: int, name: str = ""
) -> CameraImage:
    """One image of objects at poses, with noise in depth."""
    rng = np.random.default_rng(seed)
    meshes = [(model.mesh, pose) for model, pose in parts]
    rgb, depth, _ = render_scene([*meshes, (TABLE, TABLE_POSE)], CAMERA, SHAPE, FRONTAL_LIGHT)
    noisy = depth + rng.normal(scale=0.001, size=SHAPE) * (depth > 0)
    noisy[rng.random(SHAPE) < 0.03] = 0.0
    return CameraImage(rgb, noisy.astype(np.float32), CAMERA, name)


class SimulatedCamera:
    """Images of objects that follow paths, one after another; a pose of nan hides an object."""

    def __init__(self, paths: Mapping[str, np.ndarray], models: Mapping[str, ObjectModel]) -> None:
        self.paths, self.models, self.closed = paths, models, False

    def __iter__(self) -> Iterator[CameraImage]:
        for number, poses in enumerate(zip(*self.paths.values(), strict=True)):
            named = zip(self.paths, poses, strict=True)
            parts = [(self.models[name.split("#")[0]], pose) for name, pose in named]
            shown = [part for part in parts if np.isfinite(part[1]).all()]
            yield picture(shown, number, f"{number:06d}")

    def close(self) -> None:
        self.closed = True
