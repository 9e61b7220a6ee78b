"""Boxes without colours, packed side by side, and what a camera sees of them."""

from types import SimpleNamespace

import numpy as np
import trimesh

from hlp.geometry import rigid
from hlp.image_edges import color_edges
from hlp.refinement.verification import VerificationSettings, Verifier, observe
from hlp.rendering.rasterizer import render_depth
from refinement_scene import CAMERA, SHAPE, colorless, model_of

SIZE = np.array([0.06, 0.1, 0.04])  # m
TURN = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
PLACES = np.array([[-0.1, 0.0, 0.8], [0.0, 0.0, 0.8], [0.1, 0.0, 0.8], [0.0, -0.06, 0.8]])
POSES = rigid(TURN, PLACES)
WHITE, RED = (230, 230, 225), (170, 30, 30)
QUARTER = np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])
PAIR = rigid(np.eye(3), np.array([[-0.02, 0.0, 0.8], [0.02, 0.0, 0.8]]))
PAIR_WHOLE = rigid(QUARTER, np.array([0.0, 0.0, 0.78]))
"""Two boxes of 4 × 10 × 8 cm side by side, and one that lies in their place."""


def box(size=SIZE):
    """A verifier of a box of this size (m)."""
    return verifier_of(trimesh.creation.box(size))


def verifier_of(shape):
    """A verifier of a part without colours."""
    return Verifier(colorless(model_of(shape)), VerificationSettings())


def frame(verifier, *colors, poses=POSES):
    """Boxes at the first poses, in these colours, and what is seen of them."""
    drawn = render_depth(verifier.mesh, poses[: len(colors)], CAMERA, SHAPE)
    rgb, depth = np.full((*SHAPE, 3), 60, np.uint8), np.full(SHAPE, 0.9, np.float32)
    for image, color in zip(drawn, colors, strict=True):
        rgb[image > 0], depth[image > 0] = color, image[image > 0]
    return seen_as(rgb, depth)


def seen_as(rgb, depth):
    """What attempts look at of a frame's search."""
    seen = observe(rgb, depth, CAMERA, VerificationSettings())
    frame, edges = SimpleNamespace(rgb=rgb), color_edges(rgb)
    return SimpleNamespace(frame=frame, observation=seen, color_edges=lambda: edges)
