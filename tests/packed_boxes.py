"""Boxes without colours, packed side by side, and what a camera sees of them."""

from dataclasses import dataclass, replace
from types import SimpleNamespace

import numpy as np
import trimesh

from hlp.arrays import Image
from hlp.geometry import rigid
from hlp.records import ObjectModel
from hlp.refinement.verification import Observation, VerificationSettings, Verifier, observe
from hlp.rendering.rasterizer import render_depth
from refinement_scene import CAMERA, SHAPE, as_mesh

SIZE = np.array([0.06, 0.1, 0.04])  # m
TURN = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
PLACES = np.array([[-0.1, 0.0, 0.8], [0.0, 0.0, 0.8], [0.1, 0.0, 0.8], [0.0, -0.06, 0.8]])
POSES = rigid(TURN, PLACES)
WHITE, RED = (230, 230, 225), (170, 30, 30)
QUARTER = np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])
WRONG = rigid(TURN @ QUARTER, PLACES[1] + [0.0, 0.0, (SIZE[0] - SIZE[2]) / 2])
"""The second box with another of its faces in front, in the plane of the true one."""
PAIR = rigid(np.eye(3), np.array([[-0.02, 0.0, 0.8], [0.02, 0.0, 0.8]]))
"""Two boxes of 4 × 10 × 8 cm side by side, and one lying in their place."""
PAIR_WHOLE = rigid(QUARTER, np.array([0.0, 0.0, 0.78]))


@dataclass
class Packed:
    """The frame of a search, as far as attempts look at it."""

    frame: SimpleNamespace
    observation: Observation
    estimator: object = None

    @classmethod
    def of(cls, rgb: np.ndarray, depth: Image) -> "Packed":
        """What a camera sees."""
        seen = observe(rgb, depth, CAMERA, VerificationSettings())
        return cls(SimpleNamespace(rgb=rgb), seen)

    def observed_again(self) -> "Packed":
        """The same after the picture was changed."""
        return self.of(self.frame.rgb, self.observation.depth)


def box(size=SIZE):
    """A verifier of a box of this size (m)."""
    mesh = replace(as_mesh(trimesh.creation.box(size)), colored=False)
    diameter = float(np.linalg.norm(size))
    model = ObjectModel(1, "box", mesh, mesh, diameter, np.eye(4)[None], 0.1, 0.04)
    return Verifier(model, VerificationSettings())


def frame(verifier, *colors, poses=POSES):
    """Boxes at the first poses, in these colours, and what is seen of them."""
    drawn = render_depth(verifier.mesh, poses[: len(colors)], CAMERA, SHAPE)
    rgb, depth = np.full((*SHAPE, 3), 60, np.uint8), np.full(SHAPE, 0.9, np.float32)
    for image, color in zip(drawn, colors, strict=True):
        rgb[image > 0], depth[image > 0] = color, image[image > 0]
    return Packed.of(rgb, depth)
