"""What the answers in an image hide of each other.

Packed parts touch: the side of one lies behind the front of its neighbour by less than the
verification tolerates (τ_d). Compared with the neighbour's depth, it would speak against the part.
"""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from hlp.arrays import Image, Pose
from hlp.geometry import project, transform
from hlp.refinement.verification import Observation, Verifier
from hlp.rendering.rasterizer import render_depth

BORDER = 5  # px around an object that are drawn with it
_IN_FRONT = 0.002  # m: poses are no more exact (D)
_NEARER = 0.5  # of its distance: by far more than τ_d in front of it


@dataclass(frozen=True)
class Surface:
    """Depth (m, 0: nothing) of an object at a pose, in the part of an image around it."""

    rows: slice
    columns: slice
    depth: Image

    @classmethod
    def of(cls, verifier: Verifier, observation: Observation, pose_cam_obj: Pose) -> Self:
        """That of the verifier's object; the part is the whole image where it is not in front."""
        points = transform(pose_cam_obj, verifier.mesh.vertices)
        height, width = observation.depth.shape
        low, high = np.zeros(2, int), np.array([width, height])
        if points[:, 2].min() > 0.0:
            pixels = project(points, observation.camera_matrix)
            low = np.clip(np.floor(pixels.min(axis=0)).astype(int) - BORDER, 0, high - 1)
            high = np.clip(np.ceil(pixels.max(axis=0)).astype(int) + BORDER, low + 1, high)
        camera_matrix = observation.camera_matrix.copy()
        camera_matrix[:2, 2] -= low
        shape = (int(high[1] - low[1]), int(high[0] - low[0]))
        depth = render_depth(verifier.mesh, pose_cam_obj[None], camera_matrix, shape, threads=1)
        return cls(slice(int(low[1]), int(high[1])), slice(int(low[0]), int(high[0])), depth[0])

    def seen_around(self, other: "Surface") -> Image:
        """Its depth in the part of the image around another one."""
        depth = np.zeros_like(other.depth)
        pairs = (self.rows, other.rows), (self.columns, other.columns)
        spans = [(max(a.start, b.start), min(a.stop, b.stop)) for a, b in pairs]
        there, here = (
            tuple(
                slice(first - span.start, max(first, last) - span.start)
                for (first, last), span in zip(spans, (of.rows, of.columns), strict=True)
            )
            for of in (other, self)
        )
        depth[there] = self.depth[here]
        return depth


def with_hidden(observation: Observation, own: Surface, others: Iterable[Surface]) -> Observation:
    """The image where everything that others hide of a surface lies far behind them.

    They hide it where they are in front of it, and are nearer to the depth that was observed.
    """
    seen = observation.depth[own.rows, own.columns]
    hidden = np.zeros(own.depth.shape, dtype=bool)
    for other in others:
        front = other.seen_around(own)
        before = (seen > 0.0) & (front > 0.0) & (front < own.depth - _IN_FRONT)
        hidden |= before & (np.abs(seen - front) < np.abs(seen - own.depth))
    if not hidden.any():
        return observation
    depth = observation.depth.copy()
    depth[own.rows, own.columns] = np.where(hidden, np.float32(_NEARER) * own.depth, seen)
    return replace(observation, depth=depth)
