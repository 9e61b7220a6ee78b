"""How far a motion takes a surface, and its colours, from where they were."""

import numpy as np
from jaxtyping import Float, Int
from scipy.ndimage import distance_transform_edt
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from hlp.geometry import inverse, rigid, transform
from hlp.records import Mesh
from hlp.rendering.surface_samples import sample_surface

_SAMPLES, _TESTED, _COARSE = 20_000, 1_500, 300
_CELLS, _MARGIN = 60, 6  # cells of the coarse grid along the diameter, and beside it
_WITHIN_95, _WITHIN_99 = 0.03, 0.06
_ALIGNING_STEPS = 8
_COLORS = 5  # every fifth sample is compared in colour
_SMOOTHED = 12  # samples whose colours are averaged: about 3 mm around a sample


class ShapeDistance:
    """The surface of one object, sampled evenly.

    Tolerances are fractions of the diameter: for objects of 10 to 25 cm 3 % are 3 to 8 mm, which
    depth with errors of 2 to 5 mm and a pose fitted to it hardly show. That 99 % must lie within
    6 % makes a mug's handle, 4 % of its surface, count.
    """

    def __init__(self, mesh: Mesh, diameter: float) -> None:
        samples = sample_surface(mesh, _SAMPLES)
        self.diameter, self.center = diameter, samples.points.mean(axis=0)
        self._points, self._normals = samples.points, samples.normals
        self._tree = cKDTree(self._points)
        self._tested = self._points[:: _SAMPLES // _TESTED]
        distance, near = self._tree.query(self._points, k=_SMOOTHED)
        # Beyond the samples around a point, its plane says nothing about the surface.
        self._reach = 2.0 * float(np.median(distance[:, 1])) * np.sqrt(2.0)
        self._colors = samples.colors[near].mean(axis=1)
        self._fill_grid()

    def _fill_grid(self) -> None:
        side = _CELLS + 2 * _MARGIN
        self._cell = self.diameter / _CELLS
        self._corner = self.center - side / 2 * self._cell
        empty = np.ones((side, side, side), dtype=bool)
        empty[tuple(self._cells(self._points).T)] = False
        self._grid = distance_transform_edt(empty).astype(np.float32) * np.float32(self._cell)

    def _cells(self, points: Float[np.ndarray, "*b 3"]) -> Int[np.ndarray, "*b 3"]:
        cells = ((points - self._corner) / self._cell).astype(np.int32)
        return np.asarray(np.clip(cells, 0, _CELLS + 2 * _MARGIN - 1))

    def coarse_distances(self, rotations: Float[np.ndarray, "r 3 3"]) -> Float[np.ndarray, "r"]:
        """Mean distance (m) of the surface, turned about its centre, from itself, to 1 % or so."""
        points = self._points[:: _SAMPLES // _COARSE] - self.center
        turned = np.einsum("rij,pj->rpi", rotations, points) + self.center
        cells = self._cells(turned)
        found = self._grid[cells[..., 0], cells[..., 1], cells[..., 2]]
        return np.asarray(found.mean(axis=1), dtype=np.float64)

    def distances(self, motion: Float[np.ndarray, "4 4"]) -> Float[np.ndarray, "n"]:
        """Distances (m) of the moved surface from the surface, and of the surface from the moved.

        Near a sample they are those to its plane.
        """
        found = []
        for each in (motion, inverse(motion)):
            moved = transform(each, self._tested)
            distance, nearest = self._tree.query(moved)
            offset = moved - self._points[nearest]
            across = np.abs(np.einsum("ij,ij->i", offset, self._normals[nearest]))
            along = np.sqrt(np.maximum(distance**2 - across**2, 0.0))
            found.append(np.where(along < self._reach, across, distance))
        return np.concatenate(found)

    def are_alike(self, motions: Float[np.ndarray, "n 4 4"]) -> bool:
        """Whether all motions leave 95 % of the surface within 3 % of the diameter, 99 % in 6 %."""
        for motion in motions:
            most, nearly_all = np.quantile(self.distances(motion), [0.95, 0.99]) / self.diameter
            if most > _WITHIN_95 or nearly_all > _WITHIN_99:
                return False
        return True

    def aligned(self, motion: Float[np.ndarray, "4 4"]) -> Float[np.ndarray, "4 4"]:
        """The motion that maps the surface best onto itself near a given one (point-to-plane ICP).

        The farthest fifth of the points is left out of each step.
        """
        points = self._tested[::2]
        for _ in range(_ALIGNING_STEPS):
            moved = transform(motion, points)
            distance, nearest = self._tree.query(moved)
            normals = self._normals[nearest]
            limit = max(float(np.quantile(distance, 0.8)), 0.005 * self.diameter)
            used = (distance <= limit)[:, None]
            residual = ((self._points[nearest] - moved) * normals).sum(axis=1)
            rows = np.concatenate([np.cross(moved - self.center, normals), normals], axis=1) * used
            # A little damping, because surfaces of revolution slide along themselves.
            damping = 1e-9 * len(points) * np.diag([self.diameter**2] * 3 + [1.0] * 3)
            step = np.linalg.solve(rows.T @ rows + damping, rows.T @ residual)
            turn = Rotation.from_rotvec(step[:3]).as_matrix()
            motion = rigid(turn, step[3:] + self.center - turn @ self.center) @ motion
        return motion

    def color_difference(self, motion: Float[np.ndarray, "4 4"]) -> float:
        """Root mean square difference (of 255) of the smoothed colours after a motion."""
        _, nearest = self._tree.query(transform(motion, self._points[::_COLORS]))
        return float(np.sqrt(np.mean((self._colors[nearest] - self._colors[::_COLORS]) ** 2)))
