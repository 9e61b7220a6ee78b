"""Lay all templates on all places of an image: which of their features the image has there.

Places of about one depth see a feature at the same distance in pixels. So its answers lie side by
side when those of pixels that are a step apart do ("linearized memories" of Hinterstoisser et al.,
LINEMOD, PAMI 2012), and one instruction adds those of many places. Where the first features are
found in this way, they are looked for again, at the very depth of the place.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Float32, Int32, Int64, UInt8, UInt64

from hlp.arrays import Points
from hlp.kernels import compiled, compiled_ahead
from hlp.templates.building import SURFACE, Templates

SAME = 4
"""Answer of an edge of the feature's direction; others' are less."""
PER_PLACE = 6
"""Templates that are kept at each place."""
_FIRST = 16  # features after which a place that has too few of them is left; none has fewer
_MOST_MISSING, _MOST_UNSEEN = 4, 9  # points that are missing; those, and points behind something
_LEAST_COSINE = 0.7  # of the angle between the normals at an anchor and at a place (D)
_SLACK = 4  # of the first features' answers: these depths are not the same
_ENOUGH, _ANY_ENOUGH = np.uint8(0x80), np.uint64(0x8080808080808080)  # bit of sums, in a word


class Places(NamedTuple):
    """Where templates are laid: pixels (x, y), their depths (m) and the points (m) they show.

    `turns` take a view from the optical axis to the ray of a place; `normals` are the surface's
    unit normals, turned back to the axis, away from the camera, or 0 where the depth has a step.
    """

    pixels: Float32[np.ndarray, "p 2"]
    depths: Float32[np.ndarray, "p"]
    points: Points
    turns: Float[np.ndarray, "p 3 3"]
    normals: Float32[np.ndarray, "p 3"]


class ScannedImage(NamedTuple):
    """An image within a border, so that no point of a template need be looked for outside it.

    Row by row, `near` are the directions of near edges and `depth` the depths (m); `answers` are
    those of features of each direction to such edges. `by_place` holds the answers for all pixels:
    those at one pixel of all cells, of `s` px, side by side. The answer `x` and `y` px from a place
    is `across[x + border] + down[y + border]` after the first of the place's cell.
    """

    near: UInt8[np.ndarray, "n"]
    depth: Float32[np.ndarray, "n"]
    width: int
    answers: UInt8[np.ndarray, "8 256"]
    by_place: UInt8[np.ndarray, "8 s s r c"]
    across: Int64[np.ndarray, "n"]
    down: Int64[np.ndarray, "n"]


@compiled_ahead()
def arrange(
    near: UInt8[np.ndarray, "h w"],
    answers: UInt8[np.ndarray, "8 256"],
    by_place: UInt8[np.ndarray, "8 s s r c"],
) -> None:
    """Write `ScannedImage.by_place`, which the array has the shape of."""
    step, rows, columns = by_place.shape[2:]
    for direction in range(len(answers)):
        for y in range(step):
            for x in range(step):
                for row in range(rows):
                    for column in range(columns):
                        here = near[row * step + y, column * step + x]
                        by_place[direction, y, x, row, column] = answers[direction, here]


@compiled_ahead(fastmath=True)
def scan(
    image: ScannedImage,
    places: Places,
    groups: tuple[Int64[np.ndarray, "p"], Float32[np.ndarray, "g"]],
    templates: Templates,
    limits: tuple[np.float32, np.float32, np.float32, np.float32],
    shares: Float32[np.ndarray, "p k"],
    rows: Int32[np.ndarray, "p k"],
) -> None:
    """The best templates at each place, and the shares of their features that the image has.

    The `groups` of places have one depth (m) each. The `limits` are the focal length, the largest
    scale (px / m), and those of depth and share.
    """
    cells = image.by_place.shape[3] * image.by_place.shape[4]
    starts, sums = np.zeros(cells, np.uint8), np.zeros(cells // 8 * 8 + 8, np.uint8)
    place_of, likely = np.zeros(cells, np.int64), np.zeros(cells, np.int64)
    answers, features = image.by_place.reshape(-1), np.zeros(_FIRST, np.uint64)
    for group in range(len(groups[1])):
        first, count = _take_group(image, places, groups[0], group, limits[3], starts, place_of)
        for t in range(len(templates.offsets)):
            scale = limits[0] / (groups[1][group] - np.float32(templates.anchors_cam[t, 2]))
            if count > 0 and 0.0 < scale <= limits[1]:
                _locate(image, templates, t, scale, first, features)
                _sum_answers(answers, features, starts[first:], count, sums)
                found = _list_likely(sums, count, place_of[first:], likely)
                _compare(image, places, likely[:found], templates, t, limits, shares, rows)


@compiled()
def _take_group(
    image: ScannedImage,
    places: Places,
    groups: Int64[np.ndarray, "p"],
    group: int,
    least: np.float32,
    starts: UInt8[np.ndarray, "c"],
    place_of: Int64[np.ndarray, "c"],
) -> tuple[int, int]:
    """First cell of a group and the number up to its last: sums start so that enough has a bit."""
    step, columns = image.by_place.shape[2], image.by_place.shape[4]
    start = 128 - max(int(np.ceil(least * SAME * _FIRST)) - _SLACK, 0)
    starts[:] = 0
    first, last = len(starts), -1
    for place in range(len(groups)):
        if groups[place] == group:
            column, row = int(places.pixels[place, 0]) // step, int(places.pixels[place, 1]) // step
            cell = row * columns + column
            starts[cell], place_of[cell] = start, place
            first, last = min(first, cell), max(last, cell)
    return first, max(last + 1 - first, 0)


@compiled(fastmath=True)
def _locate(
    image: ScannedImage,
    templates: Templates,
    t: int,
    scale: np.float32,
    first: int,
    features: UInt64[np.ndarray, "n"],
) -> None:
    """Where the answers to the first features of a template at a cell lie among all."""
    middle, pixels = np.float32(len(image.across) // 2) + np.float32(0.5), image.by_place[0].size
    offsets, directions = templates.offsets[t], templates.directions[t]
    for k in range(_FIRST):
        x, y = middle + scale * offsets[k, 0], middle + scale * offsets[k, 1]
        features[k] = directions[k] * pixels + image.down[int(y)] + image.across[int(x)] + first


@compiled()
def _sum_answers(
    answers: UInt8[np.ndarray, "n"],
    features: UInt64[np.ndarray, "f"],
    starts: UInt8[np.ndarray, "c"],
    count: int,
    sums: UInt8[np.ndarray, "c"],
) -> None:
    """Add the answers to the first features in consecutive cells: many by one instruction."""
    for i in range(count):
        sums[i] = starts[i]
    for k in range(0, _FIRST, 4):
        a, b, c, d = features[k], features[k + 1], features[k + 2], features[k + 3]
        for i in range(np.uint64(count)):
            # Added one by one, lest the compiler widens them.
            sums[i] = np.uint8(
                sums[i] + answers[a + i] + answers[b + i] + answers[c + i] + answers[d + i]
            )


@compiled()
def _list_likely(
    sums: UInt8[np.ndarray, "c"],
    count: int,
    place_of: Int64[np.ndarray, "c"],
    likely: Int64[np.ndarray, "c"],
) -> int:
    """List the places whose sums have the bit; how many there are."""
    words, found = sums.view(np.uint64), 0
    for word in range((count + 7) // 8):
        if words[word] & _ANY_ENOUGH != 0:
            for cell in range(8 * word, min(8 * word + 8, count)):
                likely[found] = place_of[cell]
                found += sums[cell] >= _ENOUGH
    return found


@compiled(fastmath=True)
def _compare(
    image: ScannedImage,
    places: Places,
    likely: Int64[np.ndarray, "n"],
    templates: Templates,
    t: int,
    limits: tuple[np.float32, np.float32, np.float32, np.float32],
    shares: Float32[np.ndarray, "p k"],
    rows: Int32[np.ndarray, "p k"],
) -> None:
    """Lay one template on likely places: keep the share of its features that each has."""
    pixels, depths, normals = places.pixels, places.depths, places.normals
    facing, whole = templates.normals_cam[t], np.float32(SAME * templates.offsets.shape[1])
    offsets, directions = templates.offsets[t], templates.directions[t]
    near, depth, answers, width = image.near, image.depth, image.answers, image.width
    for place in likely:
        cosine = normals[place, 0] * facing[0] + normals[place, 1] * facing[1]
        cosine += normals[place, 2] * facing[2]
        if cosine < np.float32(_LEAST_COSINE) and cosine != 0.0:  # 0: either has no normal
            continue
        x_0, y_0, here = pixels[place, 0], pixels[place, 1], depths[place]
        scale = limits[0] / (here - np.float32(templates.anchors_cam[t, 2]))
        if not 0.0 < scale <= limits[1]:
            continue
        found = np.int32(0)
        for k in range(_FIRST):
            x, y = x_0 + scale * offsets[k, 0], y_0 + scale * offsets[k, 1]
            found += answers[directions[k], near[np.uint32(int(y) * width + int(x))]]
        if found < limits[3] * np.float32(SAME * _FIRST):
            continue
        if not _is_seen(depth, width, here, x_0, y_0, scale, templates.surface[t], limits[2]):
            continue
        for k in range(_FIRST, len(offsets)):
            x, y = x_0 + scale * offsets[k, 0], y_0 + scale * offsets[k, 1]
            found += answers[directions[k], near[np.uint32(int(y) * width + int(x))]]
        _keep(np.float32(found) / whole, t, shares[place], rows[place])


@compiled(inline="always")
def _is_seen(
    depth: Float32[np.ndarray, "n"],
    width: int,
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
    missing, unseen = np.int32(0), np.int32(0)
    for k in range(SURFACE):
        x, y = np.int32(x_0 + scale * surface[0, k]), np.int32(y_0 + scale * surface[1, k])
        behind = depth[y * np.int32(width) + x] - here - surface[2, k]
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
