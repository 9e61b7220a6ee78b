"""Coarse poses where an image has the edges of a template: at every place, at the depth there."""

import cv2
import numpy as np
from jaxtyping import Float, Float32, Int8, Int32, UInt8

from hlp.arrays import CameraMatrix, Image, Mask, Pixels, Points, Poses, Rows
from hlp.geometry import allocentric_to_egocentric, rigid, transform
from hlp.image_edges import NO_EDGE, STEPS
from hlp.kernels import compiled, compiled_ahead
from hlp.records import Hypotheses, ObjectModel
from hlp.templates.building import DIRECTIONS, Templates, TemplateSettings
from hlp.threads import ThreadTeam

_SAME, _BESIDE = 4, 2  # response to an edge of the feature's direction, and of the next ones
_FIRST = 16  # features after which a place that has too few of them is left
_DEPTH_LIMIT, _MOST_WRONG = 0.12, 4  # of the diameter; points of the surface that may be off
_PER_PLACE = 6  # templates that are kept at each place
_PLACE = 0.4  # of the diameter: poses as close as this are at the same place
_MEDIAN = 5  # px, of the depth at a place
_NEAREST = 0.1  # m
_SAME_SHIFT, _SAME_TURN = 0.08, np.deg2rad(14.0)  # of the diameter: matches of one pose


def spread_edges(directions: Int8[np.ndarray, "h w"], reach: int) -> UInt8[np.ndarray, "8 h w"]:
    """How well each pixel answers to a feature of each direction, by the edges around it."""
    near = np.zeros(directions.shape, dtype=np.uint8)
    offsets = np.argwhere(cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * reach + 1,) * 2))
    _mark(directions, np.ascontiguousarray(offsets - reach), near)
    codes = np.arange(256)
    tables = np.zeros((DIRECTIONS, 256), dtype=np.uint8)
    for k in range(DIRECTIONS):
        beside = codes >> ((k + 1) % DIRECTIONS) | codes >> ((k - 1) % DIRECTIONS)
        tables[k] = np.where(codes >> k & 1, _SAME, np.where(beside & 1, _BESIDE, 0))
    return np.stack([cv2.LUT(near, table) for table in tables])


@compiled_ahead()
def _mark(
    directions: Int8[np.ndarray, "h w"], offsets: Pixels, near: UInt8[np.ndarray, "h w"]
) -> None:
    """Set the bit of an edge's direction in all pixels around it."""
    height, width = directions.shape
    for y in range(height):
        for x in range(width):
            if directions[y, x] == NO_EDGE:
                continue
            half = (directions[y, x] * DIRECTIONS * 2 // STEPS + 1) // 2
            bit = np.uint8(1 << (half % DIRECTIONS))
            for n in range(len(offsets)):
                v, u = y + offsets[n, 0], x + offsets[n, 1]
                if 0 <= v < height and 0 <= u < width:
                    near[v, u] |= bit


def match_templates(
    templates: Templates,
    answers: UInt8[np.ndarray, "8 h w"],
    depth: Image,
    camera_matrix: CameraMatrix,
    model: ObjectModel,
    settings: TemplateSettings,
    mask: Mask | None,
    team: ThreadTeam,
) -> Hypotheses:
    """Lay every template on a grid of places with depth (in the `mask`); the best matches.

    Of nearly equal poses only the best is kept; its support is the share of features found.
    """
    smooth = cv2.medianBlur(np.ascontiguousarray(depth, dtype=np.float32), _MEDIAN)
    places, depths = _grid_places(smooth, mask, settings.step)
    shares = np.zeros((len(places), _PER_PLACE), dtype=np.float32)
    rows = np.full(shares.shape, -1, dtype=np.int32)
    focal, ahead = np.float32(camera_matrix[0, 0]), templates.anchors_cam[:, 2].astype(np.float32)
    limits = np.float32(_DEPTH_LIMIT * model.diameter), np.float32(settings.least_match)

    def scan(a: int, b: int) -> None:
        found = shares[a:b], rows[a:b]
        _scan(answers, smooth, places[a:b], depths[a:b], focal, templates, ahead, limits, *found)

    team.map_ranges(scan, len(places))
    place, column = np.nonzero(shares >= settings.least_match)
    order = np.argsort(-shares[place, column], kind="stable")
    place, column = place[order], column[order]
    found, row = shares[place, column], rows[place, column]
    rays = np.column_stack([places[place], np.ones(len(place))]) @ np.linalg.inv(camera_matrix).T
    surface = rays * depths[place][:, None]
    turn = allocentric_to_egocentric(surface)
    rotations = turn @ templates.rotations_cam_obj[row]
    centers = surface - np.einsum("nij,nj->ni", turn, templates.anchors_cam[row])
    best = np.full(settings.compared, -1)
    shift, trace = _SAME_SHIFT * model.diameter, 1.0 + 2.0 * np.cos(_SAME_TURN)
    best = best[: _choose_different(centers, rotations, shift, trace, best)]
    poses = rigid(rotations[best], centers[best] - rotations[best] @ model.centroid)
    return Hypotheses(poses, found[best].astype(np.float64))


def _grid_places(
    depth: Image, mask: Mask | None, step: int
) -> tuple[Float32[np.ndarray, "p 2"], Float32[np.ndarray, "p"]]:
    """Pixels (x, y) every `step` px that have depth and lie in the mask, and their depths."""
    there = np.isfinite(depth) & (depth > _NEAREST)
    there = there if mask is None else there & mask
    y, x = step * np.argwhere(there[step // 2 :: step, step // 2 :: step]).T + step // 2
    return np.stack([x, y], axis=1).astype(np.float32), depth[y, x]


def at_different_places(poses_cam_obj: Poses, model: ObjectModel, most: int) -> Rows:
    """Rows of poses, the best of which come first: of each pose one, of each place `most`.

    Poses that symmetries make equal are one.
    """
    centers = transform(poses_cam_obj, model.centroid[None])[:, 0]
    rotations, trace = poses_cam_obj[:, :3, :3].reshape(-1, 9), 1.0 + 2.0 * np.cos(_SAME_TURN)
    kept = np.zeros(0, dtype=np.int64)
    for n in range(len(centers)):
        apart = np.linalg.norm(centers[kept] - centers[n], axis=1) / model.diameter
        alike = (poses_cam_obj[n, :3, :3] @ model.symmetries[:, :3, :3]).reshape(-1, 9)
        same = (alike @ rotations[kept[apart < _SAME_SHIFT]].T > trace).any()
        if not same and np.count_nonzero(apart < _PLACE) < most:
            kept = np.append(kept, n)
    return kept


@compiled_ahead(fastmath=True)
def _scan(
    answers: UInt8[np.ndarray, "8 h w"],
    depth: Float32[np.ndarray, "h w"],
    places: Float32[np.ndarray, "p 2"],
    depths: Float32[np.ndarray, "p"],
    focal: np.float32,
    templates: Templates,
    ahead: Float32[np.ndarray, "t"],
    limits: tuple[np.float32, np.float32],
    shares: Float32[np.ndarray, "p k"],
    rows: Int32[np.ndarray, "p k"],
) -> None:
    """The best templates at each place, and the shares of their features that the image has."""
    height, width = answers.shape[1:]
    offsets, directions, surface = templates.offsets, templates.directions, templates.surface
    limit, fewest = limits[0], limits[1] * np.float32(_SAME * _FIRST)
    count, half = offsets.shape[1], np.float32(0.5)
    for p in range(len(places)):
        x_0, y_0 = places[p, 0] + half, places[p, 1] + half
        for t in range(len(offsets)):
            scale = focal / (depths[p] - ahead[t])
            wrong = 0
            for k in range(surface.shape[1]):
                x, y = int(x_0 + scale * surface[t, k, 0]), int(y_0 + scale * surface[t, k, 1])
                inside = 0 <= x < width and 0 <= y < height
                wrong += not (inside and abs(depth[y, x] - depths[p] - surface[t, k, 2]) <= limit)
                if wrong > _MOST_WRONG:
                    break
            if wrong > _MOST_WRONG:
                continue
            found = 0
            for k in range(count):
                x, y = int(x_0 + scale * offsets[t, k, 0]), int(y_0 + scale * offsets[t, k, 1])
                if 0 <= x < width and 0 <= y < height:
                    found += answers[directions[t, k], y, x]
                if k == _FIRST - 1 and found < fewest:
                    break
            share = np.float32(found) / np.float32(_SAME * count)
            _keep(share, t, shares[p], rows[p])


@compiled(inline="always")
def _keep(
    share: np.float32, row: int, shares: Float32[np.ndarray, "k"], rows: Int32[np.ndarray, "k"]
) -> None:
    """Put a template among the best of its place, which are in descending order."""
    place = len(shares)
    while place > 0 and shares[place - 1] < share:
        place -= 1
        if place + 1 < len(shares):
            shares[place + 1], rows[place + 1] = shares[place], rows[place]
    if place < len(shares):
        shares[place], rows[place] = share, row


@compiled_ahead()
def _choose_different(
    centers: Points, rotations: Float[np.ndarray, "n 3 3"], shift: float, trace: float, chosen: Rows
) -> int:
    """Choose poses that differ from all that were chosen before; how many were."""
    count = 0
    for n in range(len(centers)):
        new = True
        for m in chosen[:count]:
            apart, alike = 0.0, 0.0
            for i in range(3):
                apart += (centers[n, i] - centers[m, i]) ** 2
                for j in range(3):
                    alike += rotations[n, i, j] * rotations[m, i, j]
            if apart < shift * shift and alike > trace:
                new = False
                break
        if new:
            chosen[count] = n
            count += 1
            if count == len(chosen):
                break
    return count
