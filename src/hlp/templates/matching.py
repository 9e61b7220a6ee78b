"""Coarse poses where an image has the edges of a template: at every place, at the depth there."""

import cv2
import numpy as np
from jaxtyping import Float, Float32, Int, Int8, Int32, UInt8

from hlp.arrays import CameraMatrix, Image, Mask, Pixels, Points, Poses, Rows
from hlp.geometry import allocentric_to_egocentric, rigid, transform
from hlp.image_edges import NO_EDGE, STEPS
from hlp.kernels import compiled_ahead
from hlp.records import Hypotheses, ObjectModel
from hlp.templates.building import DIRECTIONS, Templates, TemplateSettings
from hlp.templates.scanning import PER_PLACE, SAME, Places, ScannedImage, arrange, scan
from hlp.threads import ThreadTeam

_DEPTH_LIMIT = 0.12  # of the diameter: a point of the surface that is farther off is missing
_NORMAL_REACH = 5  # px: neighbours from which a normal is computed
_STEP = 0.1  # of the diameter: where the depth jumps that far, there is no normal
_PLACE = 0.4  # of the diameter: poses as close as this are at the same place
_MEDIAN = 5  # px, of the depth at a place
_NEAREST = 0.1  # m: the nearest depth
_SPREAD = 0.07  # of the depths that are looked at together
_BESIDE = SAME // 2  # answer of an edge of the next direction
_SAME_SHIFT, _SAME_TURN = 0.08, np.deg2rad(14.0)  # of the diameter: matches of one pose


def spread_edges(directions: Int8[np.ndarray, "h w"], reach: int) -> UInt8[np.ndarray, "h w"]:
    """The directions of the edges around each pixel: a bit for each eighth of half a turn."""
    near = np.zeros(directions.shape, dtype=np.uint8)
    offsets = np.argwhere(cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * reach + 1,) * 2))
    _mark(directions, np.ascontiguousarray(offsets - reach), near)
    return near


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
    near: UInt8[np.ndarray, "h w"],
    depth: Image,
    camera_matrix: CameraMatrix,
    model: ObjectModel,
    settings: TemplateSettings,
    mask: Mask | None,
    team: ThreadTeam,
) -> tuple[Hypotheses, Int[np.ndarray, "2 b"]]:
    """Lay every template on a grid of places with depth (in the `mask`); the best matches.

    Of nearly equal poses only the best is kept; its support is the share of features found. `near`
    are the directions of near edges (`spread_edges`). The second value are the places (x, y) where
    none matches: where less depth is left, none will.
    """
    known = np.where(np.isfinite(depth), depth, 0.0).astype(np.float32)
    smooth = cv2.medianBlur(known, _MEDIAN)
    places = _grid_places(smooth, mask, settings.step, camera_matrix, _STEP * model.diameter)
    limits, of = (_DEPTH_LIMIT * model.diameter, settings.least_match), (places, templates)
    shares, rows = best_templates(
        *of, near, smooth, camera_matrix[0, 0], settings.step, limits, team
    )
    place, column = np.nonzero(shares >= settings.least_match)
    order = np.argsort(-shares[place, column], kind="stable")
    place, column = place[order], column[order]
    found, row = shares[place, column], rows[place, column]
    turns = places.turns[place]
    rotations = turns @ templates.rotations_cam_obj[row]
    centers = places.points[place] - np.einsum("nij,nj->ni", turns, templates.anchors_cam[row])
    best = np.full(settings.compared, -1)
    shift, trace = _SAME_SHIFT * model.diameter, 1.0 + 2.0 * np.cos(_SAME_TURN)
    best = best[: _choose_different(centers, rotations, shift, trace, best)]
    poses = rigid(rotations[best], centers[best] - rotations[best] @ model.centroid)
    barren = places.pixels[shares[:, 0] < settings.least_match].T.astype(np.int64)
    return Hypotheses(poses, found[best].astype(np.float64)), barren


def _grid_places(
    depth: Image, mask: Mask | None, step: int, camera_matrix: CameraMatrix, jump: float
) -> Places:
    """Every `step` px where there is depth (in the mask); a `jump` (m) of the depth is a step."""
    there = depth > _NEAREST if mask is None else (depth > _NEAREST) & mask
    y, x = step * np.argwhere(there[step // 2 :: step, step // 2 :: step]).T + step // 2
    points, apart = _points_at(depth, x, y, camera_matrix), (_NORMAL_REACH, -_NORMAL_REACH)
    right, left = (_points_at(depth, x + by, y, camera_matrix) for by in apart)
    below, above = (_points_at(depth, x, y + by, camera_matrix) for by in apart)
    normals = np.cross(right - left, below - above)
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
    bent = np.abs([right + left - 2.0 * points, below + above - 2.0 * points])[..., 2].max(axis=0)
    normals[bent >= jump] = 0.0
    turns = allocentric_to_egocentric(points)
    return Places(
        np.stack([x, y], axis=1).astype(np.float32),
        depth[y, x],
        points,
        turns,
        np.einsum("pji,pj->pi", turns, normals).astype(np.float32),
    )


def best_templates(
    places: Places,
    templates: Templates,
    near: UInt8[np.ndarray, "h w"],
    depth: Float32[np.ndarray, "h w"],
    focal: float,
    step: int,
    limits: tuple[float, float],
    team: ThreadTeam,
) -> tuple[Float32[np.ndarray, "p k"], Int32[np.ndarray, "p k"]]:
    """The best templates at each place: shares of their features that are found, and rows.

    Places are `step` px apart, the first half a step from the image's border. The `limits` are that
    of depth (m), beyond which a point of the surface is missing, and the least share.
    """
    shares = np.zeros((len(places.pixels), PER_PLACE), dtype=np.float32)
    rows = np.full(shares.shape, -1, dtype=np.int32)
    far = max(np.abs(templates.offsets).max(initial=1e-6), np.abs(templates.surface).max(initial=0))
    nearest = max(
        places.depths.min(initial=np.inf) - templates.anchors_cam[:, 2].max(initial=0.0), _NEAREST
    )
    border = (min(int(focal * far / nearest), max(depth.shape) // 2) // step + 2) * step
    image = _with_border(near, depth, border, step)
    _, group = np.unique(np.floor(np.log(places.depths) / _SPREAD), return_inverse=True)
    depths = np.bincount(group, places.depths) / np.maximum(np.bincount(group), 1)
    moved = places._replace(pixels=places.pixels + np.float32(border + 0.5))
    scales = np.float32(focal), np.float32((border - step) / far)
    most, least = (np.float32(limit) for limit in limits)

    def scan_some(a: int, b: int) -> None:
        some = Places(*(part[a:b] for part in moved))
        groups, limits = (group[a:b], depths.astype(np.float32)), (*scales, most, least)
        scan(image, some, groups, templates, limits, shares[a:b], rows[a:b])

    team.map_ranges(scan_some, len(shares))
    return shares, rows


def _with_border(
    near: UInt8[np.ndarray, "h w"], depth: Float32[np.ndarray, "h w"], border: int, step: int
) -> ScannedImage:
    """An image with a border (px) on each side, of whole cells."""
    sides, answers = [(border, border + -length % step) for length in depth.shape], _answers()
    wide = np.pad(near, sides)
    rows, columns = wide.shape[0] // step, wide.shape[1] // step
    by_place = np.empty((DIRECTIONS, step, step, rows, columns), dtype=np.uint8)
    arrange(wide, answers, by_place)
    apart = np.arange(-border, border) + step // 2
    across = apart // step + apart % step * rows * columns
    down = apart // step * columns + apart % step * step * rows * columns
    around = np.pad(depth, sides).ravel()
    return ScannedImage(wide.ravel(), around, wide.shape[1], answers, by_place, across, down)


def _answers() -> UInt8[np.ndarray, "8 256"]:
    """How well a feature of each direction is answered by edges near it, by their bits."""
    own, bits = np.arange(DIRECTIONS)[:, None], np.arange(256)
    same, *beside = (bits >> (own + by) % DIRECTIONS & 1 for by in (0, 1, -1))
    return np.where(same, SAME, np.where(np.any(beside, axis=0), _BESIDE, 0)).astype(np.uint8)


def _points_at(depth: Image, x: Rows, y: Rows, camera_matrix: CameraMatrix) -> Points:
    """Points (m) that pixels show, or the nearest ones in the image."""
    x, y = np.clip(x, 0, depth.shape[1] - 1), np.clip(y, 0, depth.shape[0] - 1)
    rays = np.column_stack([x, y, np.ones(len(x))]) @ np.linalg.inv(camera_matrix).T
    return np.asarray(rays * depth[y, x][:, None])


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
