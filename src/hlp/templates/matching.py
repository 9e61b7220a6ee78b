"""Coarse poses where an image has the edges of a template: at every place, at the depth there."""

from typing import NamedTuple

import cv2
import numpy as np
from jaxtyping import Float, Float32, Int, Int8, Int32, UInt8

from hlp.arrays import CameraMatrix, Image, Mask, Pixels, Points, Poses, Rows
from hlp.geometry import allocentric_to_egocentric, rigid, transform
from hlp.image_edges import NO_EDGE, STEPS
from hlp.kernels import compiled, compiled_ahead
from hlp.records import Hypotheses, ObjectModel
from hlp.templates.building import DIRECTIONS, SURFACE, Templates, TemplateSettings
from hlp.threads import ThreadTeam

_SAME, _BESIDE = 4, 2  # answer to an edge of the feature's direction, and of the next ones
_FIRST = 16  # features after which a place that has too few of them is left; none has fewer
_DEPTH_LIMIT = 0.12  # of the diameter: a point of the surface that is farther off is missing
_MOST_MISSING, _MOST_UNSEEN = 4, 9  # such points; those, and points behind something (D)
_LEAST_COSINE = 0.7  # of the angle between the normals at an anchor and at a place (D)
_NORMAL_REACH = 5  # px: neighbours from which a normal is computed
_STEP = 0.1  # of the diameter: where the depth jumps that far, there is no normal
_PER_PLACE = 6  # templates that are kept at each place
_PLACE = 0.4  # of the diameter: poses as close as this are at the same place
_MEDIAN = 5  # px, of the depth at a place
_NEAREST = 0.1  # m: the nearest depth
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
    limits = _DEPTH_LIMIT * model.diameter, settings.least_match
    shares, rows = _best_at(places, templates, near, smooth, camera_matrix[0, 0], limits, team)
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


class _Places(NamedTuple):
    """Where templates are laid: pixels (x, y), their depths (m) and the points (m) they show.

    `turns` take a view from the optical axis to the ray of a place; `normals` are the surface's
    unit normals, turned back to the axis, away from the camera, or 0 where the depth has a step.
    """

    pixels: Float32[np.ndarray, "p 2"]
    depths: Float32[np.ndarray, "p"]
    points: Points
    turns: Float[np.ndarray, "p 3 3"]
    normals: Float32[np.ndarray, "p 3"]


def _grid_places(
    depth: Image, mask: Mask | None, step: int, camera_matrix: CameraMatrix, jump: float
) -> _Places:
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
    return _Places(
        np.stack([x, y], axis=1).astype(np.float32),
        depth[y, x],
        points,
        turns,
        np.einsum("pji,pj->pi", turns, normals).astype(np.float32),
    )


def _best_at(
    places: _Places,
    templates: Templates,
    near: UInt8[np.ndarray, "h w"],
    depth: Float32[np.ndarray, "h w"],
    focal: float,
    limits: tuple[float, float],
    team: ThreadTeam,
) -> tuple[Float32[np.ndarray, "p k"], Int32[np.ndarray, "p k"]]:
    """The best templates at each place: shares of their features that are found, and rows."""
    shares = np.zeros((len(places.pixels), _PER_PLACE), dtype=np.float32)
    rows = np.full(shares.shape, -1, dtype=np.int32)
    far = max(np.abs(templates.offsets).max(initial=1e-6), np.abs(templates.surface).max(initial=0))
    nearest = max(
        places.depths.min(initial=np.inf) - templates.anchors_cam[:, 2].max(initial=0.0), _NEAREST
    )
    # Around the image lies a border, so that no point of a template need be looked for outside it.
    border = min(int(focal * far / nearest), max(depth.shape) // 2) + 1
    wide = np.pad(depth, border)  # what lies there is not seen
    wide_near, answers = np.pad(near, border), _answers()
    moved = places._replace(pixels=places.pixels + np.float32(border + 0.5))
    most, least = (np.float32(limit) for limit in limits)
    scales = np.float32(focal), np.float32(border / far)

    def scan(a: int, b: int) -> None:
        some = _Places(*(part[a:b] for part in moved))
        limits = *scales, most, least
        _scan(wide_near, answers, wide, some, templates, limits, shares[a:b], rows[a:b])

    team.map_ranges(scan, len(shares))
    return shares, rows


def _answers() -> UInt8[np.ndarray, "8 256"]:
    """How well a feature of each direction is answered by edges near it, by their bits."""
    own, bits = np.arange(DIRECTIONS)[:, None], np.arange(256)
    same, *beside = (bits >> (own + by) % DIRECTIONS & 1 for by in (0, 1, -1))
    return np.where(same, _SAME, np.where(np.any(beside, axis=0), _BESIDE, 0)).astype(np.uint8)


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


@compiled_ahead(fastmath=True)
def _scan(
    near: UInt8[np.ndarray, "h w"],
    answers: UInt8[np.ndarray, "8 256"],
    depth: Float32[np.ndarray, "h w"],
    places: _Places,
    templates: Templates,
    limits: tuple[np.float32, np.float32, np.float32, np.float32],
    shares: Float32[np.ndarray, "p k"],
    rows: Int32[np.ndarray, "p k"],
) -> None:
    """The best templates at each place, and the shares of their features that the image has.

    Few templates find their first features, so these are looked at before the surface. The
    `limits` are the focal length, the largest scale (px / m), and those of depth and share.
    """
    offsets, directions, surface = templates.offsets, templates.directions, templates.surface
    count, width, facing = offsets.shape[1], near.shape[1], templates.normals_cam
    fewest, least = limits[3] * np.float32(_SAME * _FIRST), np.float32(_LEAST_COSINE)
    edges = near.reshape(-1)
    for p in range(len(places.pixels)):
        x_0, y_0, here = places.pixels[p, 0], places.pixels[p, 1], places.depths[p]
        n_x, n_y, n_z = places.normals[p, 0], places.normals[p, 1], places.normals[p, 2]
        for t in range(len(offsets)):
            cosine = n_x * facing[t, 0] + n_y * facing[t, 1] + n_z * facing[t, 2]
            if cosine < least and cosine != 0.0:  # 0: either has no normal
                continue
            scale = limits[0] / (here - np.float32(templates.anchors_cam[t, 2]))
            if not 0.0 < scale <= limits[1]:
                continue
            found = np.int32(0)
            for k in range(_FIRST):
                x, y = x_0 + scale * offsets[t, k, 0], y_0 + scale * offsets[t, k, 1]
                found += answers[directions[t, k], edges[np.uint32(int(y) * width + int(x))]]
            if found < fewest or not _is_seen(depth, here, x_0, y_0, scale, surface[t], limits[2]):
                continue
            for k in range(_FIRST, count):
                x, y = x_0 + scale * offsets[t, k, 0], y_0 + scale * offsets[t, k, 1]
                found += answers[directions[t, k], edges[np.uint32(int(y) * width + int(x))]]
            _keep(np.float32(found) / np.float32(_SAME * count), t, shares[p], rows[p])


@compiled(inline="always")
def _is_seen(
    depth: Float32[np.ndarray, "h w"],
    here: np.float32,
    x_0: np.float32,
    y_0: np.float32,
    scale: np.float32,
    surface: Float32[np.ndarray, "3 s"],
    limit: np.float32,
) -> bool:
    """Whether enough of a template's surface is there, the depth at its anchor being `here`.

    Without branches, several points are looked at by one instruction.
    """
    pixels, width = depth.reshape(-1), np.int32(depth.shape[1])
    missing, unseen = np.int32(0), np.int32(0)
    for k in range(SURFACE):
        x, y = np.int32(x_0 + scale * surface[0, k]), np.int32(y_0 + scale * surface[1, k])
        behind = pixels[y * width + x] - here - surface[2, k]
        missing += np.int32(behind > limit)
        unseen += np.int32(abs(behind) > limit)
    return bool(missing <= _MOST_MISSING and unseen <= _MOST_UNSEEN)


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
