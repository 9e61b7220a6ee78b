"""A synthetic scene: an object without symmetry on a table, partly hidden by a box, noisy depth."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import trimesh

from hlp.geometry import rigid
from hlp.records import Hypotheses, Mesh, ObjectModel
from hlp.refinement.choice import InstanceSearch
from hlp.refinement.refiner import Refiner
from hlp.refinement.verification import Observation, VerificationSettings, Verifier, observe
from hlp.rendering.rasterizer import render_scene
from hlp.rendering.shading import FRONTAL_LIGHT

CAMERA = np.array([[520.0, 0.0, 151.2], [0.0, 525.0, 118.7], [0.0, 0.0, 1.0]])
SHAPE = (240, 320)


@dataclass(frozen=True)
class Scene:
    model: ObjectModel
    pose: np.ndarray
    rgb: np.ndarray
    depth: np.ndarray
    camera_matrix: np.ndarray

    @property
    def seen(self) -> Observation:
        """What refiners are given."""
        return observe(self.rgb, self.depth, self.camera_matrix, VerificationSettings())


def as_mesh(shape: trimesh.Trimesh, color: tuple[int, int, int] = (180, 180, 180)) -> Mesh:
    vertices = np.array(shape.vertices, dtype=np.float64)
    colors = np.tile(np.array(color, dtype=np.uint8), (len(vertices), 1))
    return Mesh(
        vertices, np.array(shape.faces, dtype=np.int64), colors, np.array(shape.vertex_normals)
    )


def model_of(
    shape: trimesh.Trimesh, color: tuple[int, int, int] = (180, 180, 180), name: str = "part"
) -> ObjectModel:
    """An object of one colour without symmetry."""
    mesh = as_mesh(shape, color)
    spread = mesh.vertices[:, None] - mesh.vertices
    diameter = float(np.linalg.norm(spread, axis=-1).max())
    return ObjectModel(1, name, mesh, mesh, diameter, np.eye(4)[None], 0.1, 0.04)


def colorless(model: ObjectModel) -> ObjectModel:
    """The same object, of whose colours nothing is known."""
    return replace(model, mesh=replace(model.mesh, colored=False))


def make_model() -> ObjectModel:
    """A body, a tower at one end and a ball at the other; its origin lies outside of it."""
    body = trimesh.creation.box((0.10, 0.05, 0.04))
    tower = trimesh.creation.box((0.03, 0.04, 0.06))
    tower.apply_translation([0.04, 0.005, 0.04])
    ball = trimesh.creation.icosphere(subdivisions=2, radius=0.02)
    ball.apply_translation([-0.035, -0.02, 0.025])
    shape = trimesh.util.concatenate([body, tower, ball])
    shape.apply_translation([0.03, -0.02, 0.05])
    return model_of(shape, (170, 90, 60), "toy")


def posed(model: ObjectModel, rotation: np.ndarray, centroid: np.ndarray) -> np.ndarray:
    return rigid(rotation, centroid - rotation @ model.centroid)


def make_scene(seed: int, hidden: bool = True) -> Scene:
    rng = np.random.default_rng(seed)
    model = make_model()
    turn = trimesh.transformations.rotation_matrix
    rotation = (turn(2.2, [1, 0, 0]) @ turn(rng.uniform(0, 6.0), [0, 0, 1]))[:3, :3]
    pose = posed(model, rotation, np.array([0.02, -0.01, 0.62]))
    table = as_mesh(trimesh.creation.box((0.8, 0.8, 0.01)))
    parts = [
        (model.mesh, pose),
        (table, rigid(turn(2.2, [1, 0, 0])[:3, :3], np.array([0, 0.04, 0.72]))),
    ]
    if hidden:
        box = as_mesh(trimesh.creation.box((0.03, 0.06, 0.03)))
        parts.append((box, rigid(np.eye(3), np.array([-0.03, 0.02, 0.5]))))
    rgb, depth, _ = render_scene(parts, CAMERA, SHAPE, FRONTAL_LIGHT)
    noisy = depth + rng.normal(scale=0.001, size=SHAPE) * (depth > 0)
    noisy[rng.random(SHAPE) < 0.05] = 0.0
    return Scene(model, pose, rgb, noisy.astype(np.float32), CAMERA)


def make_row() -> list[Scene]:
    """One image of three instances on a table, the last one half covered by a box: a scene each."""
    model = make_model()
    turn = trimesh.transformations.rotation_matrix
    rotations = [(turn(2.2, [1, 0, 0]) @ turn(a, [0, 0, 1]))[:3, :3] for a in (0.4, 2.0, 4.5)]
    poses = [
        posed(model, rotation, np.array([x, -0.01, 0.62]))
        for rotation, x in zip(rotations, (-0.13, 0.0, 0.13), strict=True)
    ]
    table = as_mesh(trimesh.creation.box((0.8, 0.8, 0.01)))
    box = as_mesh(trimesh.creation.box((0.03, 0.06, 0.03)), (60, 140, 90))
    parts = [(model.mesh, pose) for pose in poses]
    parts += [
        (table, rigid(turn(2.2, [1, 0, 0])[:3, :3], np.array([0, 0.04, 0.72]))),
        (box, rigid(np.eye(3), np.array([0.125, 0.0, 0.5]))),
    ]
    rgb, depth, _ = render_scene(parts, CAMERA, SHAPE, FRONTAL_LIGHT)
    return [Scene(model, pose, rgb, depth.astype(np.float32), CAMERA) for pose in poses]


def disturbed(scene: Scene, degrees: float, millimetres: float, seed: int) -> np.ndarray:
    """The true pose, turned about the centroid and shifted, in random directions."""
    rng = np.random.default_rng(seed)
    axis, shift = rng.normal(size=(2, 3))
    turn = trimesh.transformations.rotation_matrix(np.deg2rad(degrees), axis)[:3, :3]
    centre = scene.pose[:3, :3] @ scene.model.centroid + scene.pose[:3, 3]
    moved = centre + shift / np.linalg.norm(shift) * millimetres / 1000
    return posed(scene.model, turn @ scene.pose[:3, :3], moved)


def search_of(
    scene: Scene,
    verification: VerificationSettings,
    refiner: Refiner,
    poses: np.ndarray,
    candidates: int = 8,
    max_improvement: float = 0.1,
    most: int | None = None,
    **rules: Any,
) -> InstanceSearch:
    """A search from poses of the same support, which therefore adds nothing to the cost."""
    settings = replace(verification, candidates=candidates, max_improvement=max_improvement)
    seen = observe(scene.rgb, scene.depth, scene.camera_matrix, settings)
    coarse, verifier = Hypotheses(poses, np.ones(len(poses))), Verifier(scene.model, settings)
    rules |= {"candidates": most, "min_score": 0.5 if {"score", "early_score"} & {*rules} else None}
    return InstanceSearch(refiner, verifier, seen, coarse, seed=3, **rules)


def shifted_model(
    model: ObjectModel, offset: np.ndarray, poses: np.ndarray
) -> tuple[ObjectModel, np.ndarray]:
    """The model with all coordinates shifted by an offset (m), and the poses that show the same."""
    mesh = replace(model.mesh, vertices=model.mesh.vertices + offset)
    return replace(model, mesh=mesh, proxy=mesh), poses @ rigid(np.eye(3), -offset)


def error(scene: Scene, pose: np.ndarray) -> float:
    """Mean distance between the vertices in two poses (m)."""
    vertices = scene.model.mesh.vertices
    difference = vertices @ (pose - scene.pose)[:3, :3].T + (pose - scene.pose)[:3, 3]
    return float(np.linalg.norm(difference, axis=1).mean())
