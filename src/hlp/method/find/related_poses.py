"""Coarse poses that follow from an answer: beside it, or several within it.

All are those of the bounding box of the model, whose faces touch where parts are packed.
"""

from itertools import permutations, product
from typing import NamedTuple

import cv2
import numpy as np
from jaxtyping import Float

from hlp.arrays import Flags, Mask, Point, Pose, Poses, Values
from hlp.geometry import project, rigid, transform
from hlp.records import Hypotheses
from hlp.refinement.object_depth import ObjectDepth
from hlp.refinement.refiner import refinable
from hlp.refinement.turns import told_apart
from hlp.refinement.verification import Observation, Verifier
from hlp.rendering.zbuffer import DIRECTIONS

_SIGNS = np.array([*product((1.0, -1.0), repeat=3)])[:, None]
_SIGNED_AXES = (np.array([*permutations(np.eye(3))])[:, None] * _SIGNS).reshape(-1, 3, 3)
_QUARTERS = _SIGNED_AXES[np.linalg.det(_SIGNED_AXES) > 0.0]
"""The 24 turns that map a cube onto itself; SciPy, which has them, is slow to import."""
_MISFIT = 0.15  # of the size of several parts, by which they may differ from that of one (D)
_SMALLER = 0.3  # of it, by which they may be smaller: what is behind them is seen beside them (D)
_ALONG = np.linspace(-0.9, 0.9, 33)  # of half the face: print rarely reaches its border
_BESIDE = 0.3 * np.linspace(-1.0, 1.0, 31)  # of half the face: the edge may be that far off
_AROUND = 13  # of these lines, among which there must be no groove
_SAME_PLACE = 0.3  # of the part's least size, between centres (D)
_SAME_SURFACE = 0.005  # m between the face of the box and the model
_NEAR = 1.5  # px from an edge of depth, or 1 px from one of colour
_EDGE = 0.93  # share of a face's length: print reaches .91, clear borders of cartons 1 (D)
_ASKEW = 0.0, -0.15, -0.1, -0.05, 0.05, 0.1, 0.15  # of half the face, at the end of an edge (D)
_LONGER = 0.95  # the same of edges that are askew (D)
_IN_IMAGE = 0.33  # of the length, at least, if the image cuts it off (D)


def poses_beside(
    verifier: Verifier, observation: Observation, found: Poses, known: Poses
) -> Hypotheses:
    """Coarse poses of neighbours: turned as what was `found`, and touching it.

    They are shifted by the model's size along one of its axes. Those that fit much less well than
    `found` are left out, and those at the place of one that is `known`.
    """
    model = verifier.model
    sizes = np.diag(np.ptp(np.asarray(model.proxy.vertices, dtype=np.float64), axis=0))
    shifts = np.concatenate([sizes, -sizes])
    poses = np.repeat(found, len(shifts), axis=0)
    poses[:, :3, 3] += np.einsum("nij,kj->nki", found[:, :3, :3], shifts).reshape(-1, 3)
    poses = poses[refinable(poses, model.centroid)]
    centers, taken = (transform(each, model.centroid[None])[:, 0] for each in (poses, known))
    apart = np.linalg.norm(centers[:, None] - taken, axis=-1).min(axis=1)
    poses = poses[apart > _SAME_PLACE * sizes.max(axis=0).min()]
    limit = verifier.costs(observation, found).max() + verifier.settings.max_improvement
    poses = poses[verifier.costs(observation, poses) <= limit]
    return Hypotheses(poses, np.ones(len(poses)))


def poses_within(verifier: Verifier, observation: Observation, found: Pose) -> list[Poses]:
    """Coarse poses of each of several parts that were perhaps taken for the one that was `found`.

    Parts side by side, with another of their sides in front, may be about as large as one. They are
    told from it by edges in the image, as long as the face, where they would touch and the model
    is flat. None without those.
    """
    model, face = verifier.model, _Face.of(verifier, observation, found)
    turns = told_apart(_QUARTERS, model)
    sizes = np.abs(turns) @ face.half
    for axis in {0, 1, 2} - {face.axis}:
        across = 3 - axis - face.axis
        ratios = face.half[axis] / sizes[:, axis]
        wide: Flags = np.abs(sizes[:, across] / face.half[across] - 1.0) <= _MISFIT
        counts = {int(n) for n in np.concatenate([np.floor(ratios), np.ceil(ratios)])}
        for count in sorted(counts - {0, 1}, reverse=True):  # more of them show more edges
            longer = count / ratios - 1.0
            fits: Flags = wide & (longer <= _MISFIT) & (longer >= -_SMALLER)
            borders = 2.0 * np.arange(1, count) / count - 1.0
            if fits.any() and all(face.shows_edge(axis, at) for at in borders):
                places = np.zeros((count, 3))
                places[:, axis] = (2.0 * np.arange(count) + 1.0) / count - 1.0
                parts = [face.placed(turns[fits], p * face.half) for p in places]
                return parts if refinable(np.concatenate(parts), model.centroid).all() else []
    return []


class _Face(NamedTuple):
    """The face of a part's bounding box that looks to the camera, and where the part is seen.

    `middle` (m, in the model) and `half` its size are those of the box, `axis` and `sign` the
    outward normal of the face. Where the part is `drawn`, pixels are `agreeing` in depth.
    """

    verifier: Verifier
    observation: Observation
    pose: Pose
    middle: Float[np.ndarray, "3"]
    half: Float[np.ndarray, "3"]
    axis: int
    sign: float
    drawn: ObjectDepth
    agreeing: Mask

    @classmethod
    def of(cls, verifier: Verifier, observation: Observation, pose: Pose) -> "_Face":
        middle = verifier.model.centroid
        towards = -pose[:3, :3].T @ transform(pose, middle[None])[0]
        axis = int(np.argmax(np.abs(towards)))
        drawn = verifier.depth_of(observation, pose)
        agreeing = drawn.explains(observation.depth, verifier.tau_depth)
        half = np.ptp(np.asarray(verifier.model.proxy.vertices, dtype=np.float64), axis=0) / 2.0
        box = middle, half, axis, float(np.sign(towards[axis]))
        return cls(verifier, observation, pose, *box, drawn, agreeing)

    def placed(self, turns: Float[np.ndarray, "n 3 3"], shift: Point) -> Poses:
        """Poses turned and shifted (m) along the box's axes, their front in the face's plane."""
        shifts = np.tile(shift, (len(turns), 1))
        behind = self.half - np.abs(turns) @ self.half
        shifts[:, self.axis] += self.sign * behind[:, self.axis]
        rotations = self.pose[:3, :3] @ turns
        places = transform(self.pose, self.middle + shifts)
        return rigid(rotations, places - rotations @ self.middle)

    def shows_edge(self, axis: int, at: float) -> bool:
        """Whether the image has an edge straight across an `axis`, `at` a place between -1 and 1.

        Of a pose that is turned a little, it is askew: it must be longer then, since one of many
        lines is more often as long as print is.
        """
        return any(
            self._edge_share(axis, at + askew * _ALONG) >= (_LONGER if askew else _EDGE)
            for askew in _ASKEW
        )

    def _edge_share(self, axis: int, at: Values) -> float:
        """Share of the front's length in the image along which the image has an edge.

        The largest of lines beside each other; 0 where the model is not flat, not seen or behind.
        """
        observation, drawn, agreeing = self.observation, self.drawn, self.agreeing
        points = np.zeros((len(_BESIDE), len(_ALONG), 3))
        points[..., self.axis], points[..., axis] = self.sign, at + _BESIDE[:, None]
        points[..., 3 - axis - self.axis] = _ALONG
        points = transform(self.pose, self.middle + points.reshape(-1, 3) * self.half)
        if points[:, 2].min() <= 0.0:
            return 0.0
        pixels = project(points, observation.camera_matrix)
        along = pixels[len(_ALONG) - 1] - pixels[0]
        direction = round(float(np.arctan2(along[0], -along[1])) / np.pi * DIRECTIONS) % DIRECTIONS
        edges = observation.edges_of(self.verifier.model)
        edges = observation.depth_edge_distance if edges is None else edges
        x, y = np.floor(pixels + 0.5).astype(int).T
        height, width = observation.depth.shape
        inside = (x >= 0) & (y >= 0) & (x < width) & (y < height)
        row, column = y - drawn.rows.start, x - drawn.columns.start
        seen = (row >= 0) & (column >= 0) & (row < agreeing.shape[0]) & (column < agreeing.shape[1])
        row, column = row[seen], column[seen]
        seen[seen] = agreeing[row, column] & (
            np.abs(drawn.depth[row, column] - points[seen, 2]) < _SAME_SURFACE
        )
        near = np.zeros(len(points), dtype=bool)
        near[seen] = edges[direction, y[seen], x[seen]] <= _NEAR
        flags = np.stack([near, seen, inside]).reshape(3, len(_BESIDE), -1)
        edge, shown, length = flags.sum(axis=2)
        length = np.maximum(length, _IN_IMAGE * len(_ALONG))
        # Beside a groove of the model, an edge may be its own: what lies around must be flat, too.
        shown = cv2.blur((shown / length)[:, None], (1, _AROUND), borderType=cv2.BORDER_REPLICATE)
        return float(np.where(shown[:, 0] >= _EDGE, edge / length, 0.0).max())
