"""Random simple shapes in random colours: the demo's clutter, and parts of distractors."""

import numpy as np

from hlp.objects.shapes import (
    Color,
    cylinder,
    ellipsoid,
    lathe,
    painted,
    rounded_box,
    tube,
)
from hlp.records import Mesh

_SPACING = 0.007


def random_shape(rng: np.random.Generator, least_height: float = 0.04) -> Mesh:
    """A box, cylinder, ball, cone, ring or vase, of one colour or striped.

    Boxes, cylinders, cones and vases are `least_height` to 20 cm high.
    """
    kind = int(rng.integers(6))
    color = random_color(rng)
    width, height = rng.uniform(0.02, 0.045), rng.uniform(least_height, 0.20)
    if kind == 0:
        size = (2 * width, rng.uniform(0.03, 0.10), height)
        mesh = rounded_box(size, rng.uniform(0.002, 0.008), color, _SPACING)
    elif kind == 1:
        mesh = cylinder(width, height, color, _SPACING)
    elif kind == 2:
        mesh = ellipsoid((width, width * rng.uniform(0.8, 1.2), width), color, _SPACING)
    elif kind == 3:
        mesh = lathe([(0, 0), (width, 0), (width, 0.006), (0, height)], color, spacing=_SPACING)
    elif kind == 4:
        mesh = _ring(width, rng.uniform(0.007, 0.014), color)
    else:
        mesh = _vase(width, height, color, rng)
    if rng.uniform() < 0.4:
        return _striped(mesh, random_color(rng), rng)
    return mesh


def _ring(radius: float, thickness: float, color: Color) -> Mesh:
    """A ring standing on its edge."""
    angle = np.linspace(0.0, 2 * np.pi, 40)
    circle = np.column_stack([np.cos(angle), np.zeros(40), np.sin(angle)]) * radius
    return tube(circle.tolist(), [thickness] * 40, color, _SPACING)


def _vase(width: float, height: float, color: Color, rng: np.random.Generator) -> Mesh:
    heights = np.linspace(0.0, height, 5)
    radii = width * rng.uniform(0.3, 1.0, 5)
    wall = [(float(r), float(z)) for r, z in zip(radii, heights, strict=True)]
    return lathe([(0.0, 0.0), *wall, (0.0, height)], color, spacing=_SPACING)


def _striped(mesh: Mesh, color: Color, rng: np.random.Generator) -> Mesh:
    """Stripes perpendicular to a random direction, like the print on packages."""
    direction = rng.normal(size=3)
    direction /= np.linalg.norm(direction)
    along = mesh.vertices @ direction
    return painted(mesh, np.sin(2 * np.pi * along / rng.uniform(0.03, 0.09)) > 0.3, color)


def toy_tree(crown: float, height: float, rng: np.random.Generator) -> Mesh:
    """A tree of a foot, a thin trunk, and a crown of radius `crown` (m) centred at `height` (m)."""
    half = crown * rng.uniform(0.9, 1.6)
    angle = np.linspace(-np.pi / 2, np.pi / 2, 9)[1:-1]
    low = max(height - half, 0.012)
    rounds = [(float(crown * np.cos(a)), float(low + half * (1 + np.sin(a)))) for a in angle]
    foot = [(0.0, 0.0), (0.7 * crown, 0.0), (0.7 * crown, 0.006), (0.006, 0.009), (0.006, low)]
    tree = lathe([*foot, *rounds, (0.0, low + 2 * half)], random_color(rng), spacing=_SPACING)
    return painted(tree, tree.vertices[:, 2] < low + 0.004, random_color(rng))


def random_color(rng: np.random.Generator) -> Color:
    """A muted random colour (red, green, blue)."""
    grey = rng.uniform(30.0, 225.0)
    channels = np.clip(grey + rng.normal(0.0, 45.0, 3), 10, 240).astype(int)
    red, green, blue = (int(value) for value in channels)
    return red, green, blue
