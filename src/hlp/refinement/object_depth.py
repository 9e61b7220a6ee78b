"""The depth of an object at a pose, in the part of an image around it, and what hides it there."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Self

import numpy as np

from hlp.arrays import CameraMatrix, Image, Mask, Pose
from hlp.geometry import transform
from hlp.records import Mesh
from hlp.refinement.cost_kernel import draw_mesh
from hlp.rendering.rasterizer import project_corners, spanned_box
from hlp.rendering.zbuffer import prepare_mesh

BORDER = 5  # px around the object: more than what is looked at around one of its pixels
_IN_FRONT = 0.002  # m: poses are no more exact (D)


@dataclass(frozen=True)
class ObjectDepth:
    """Depth (m, 0: nothing) of an object in some rows and columns of an image; 0 in all others."""

    rows: slice
    columns: slice
    depth: Image

    @classmethod
    def of(
        cls, mesh: Mesh, pose_cam_obj: Pose, camera_matrix: CameraMatrix, shape: tuple[int, int]
    ) -> Self:
        """That of a mesh at a pose, `BORDER` pixels around it included, in an image of a shape."""
        corners = project_corners(transform(pose_cam_obj, mesh.vertices), camera_matrix)
        rows, columns = spanned_box(corners, shape, BORDER)
        pose, camera = (np.array(each, dtype=np.float64) for each in (pose_cam_obj, camera_matrix))
        camera[:2, 2] -= columns.start, rows.start
        size = rows.stop - rows.start, columns.stop - columns.start
        return cls(rows, columns, draw_mesh(pose, prepare_mesh(mesh), camera, *size))

    def part(self, image: Image) -> Image:
        """The rows and columns of a whole image."""
        return np.asarray(image[self.rows, self.columns])

    def explains(self, depth: Image, tolerance: float) -> Mask:
        """Pixels of the part whose depth (m), in a whole image, the object explains."""
        near = np.abs(self.part(depth) - self.depth) <= tolerance
        return np.asarray((self.depth > 0.0) & near)

    def hidden_by(self, others: Iterable["ObjectDepth"], depth: Image) -> Mask:
        """Pixels of the part where others hide the object.

        They are in front of it there, and nearer to the `depth` that the whole image shows.

        Packed parts touch: the side of one lies behind the front of its neighbour by less than the
        verification tolerates (τ_d), so that it would speak against a right pose.
        """
        hidden = np.zeros(self.depth.shape, dtype=bool)
        for other in others:
            before = other._in_part_of(self) < self.depth - _IN_FRONT
            hidden |= before & self.worse_than(other, depth)
        return hidden

    def worse_than(self, other: "ObjectDepth", depth: Image) -> Mask:
        """Pixels of the part where another object is nearer to the `depth` of the whole image."""
        seen, its = self.part(depth), other._in_part_of(self)
        both = (seen > 0.0) & (self.depth > 0.0) & (its > 0.0)
        return np.asarray(both & (np.abs(seen - its) < np.abs(seen - self.depth)))

    def _in_part_of(self, other: "ObjectDepth") -> Image:
        """Its depth in the rows and columns of another one."""
        depth = np.zeros_like(other.depth)
        here, there = [], []
        for own, wanted in ((self.rows, other.rows), (self.columns, other.columns)):
            first = max(own.start, wanted.start)
            last = max(min(own.stop, wanted.stop), first)
            here.append(slice(first - own.start, last - own.start))
            there.append(slice(first - wanted.start, last - wanted.start))
        depth[tuple(there)] = self.depth[tuple(here)]
        return depth
