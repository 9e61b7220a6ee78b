"""Where an object probably is (paper, section 3.1): region, likely places, pixels of patches."""

from bisect import bisect_right
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Annotated, Literal

import numpy as np
from annotated_types import Interval, Le, Unit

from hlp.arrays import Flags, Mask, Pixels, Positions, Rows, Values
from hlp.kernels import compiled_ahead
from hlp.patches.holistic import Windows, center_depths, pixel_grid
from hlp.patches.local import GridSettings
from hlp.records import Frame, ObjectModel, Region
from hlp.settings import Count, CountOrNone, Doc, Positive, PositiveOrNone, Settings, WholeNumber

_NEAREST = 0.1  # m: where depth is missing or less, a window is as large as there
_MIN_WEIGHT = 0.01
_ROUNDS = 8  # in which patches are shared out
_COMPARABLE = 0.1  # of the first: the least probability of windows accepted beside it
_COARSE = 4  # px
_LEAST = 0.02  # p(object): where it is lower, the classifier hardly ever errs
_LEAST_UNKNOWN = 0.15  # the same where the object may be absent: places take time (D)
_MOST_UNKNOWN = 9  # such places of an object with colours: later ones hardly ever hold it (D)


@dataclass(frozen=True)
class RegionSettings(Settings):
    """Where windows lie and how their probabilities become a region."""

    step: Annotated[
        Count,
        Le(1000),
        Unit("px"),
        Doc("step between windows; 16 makes a quarter of the paper's (D; P: 8)"),
    ] = 16
    threshold: Annotated[
        float | None,
        Interval(gt=0, le=1),
        Doc("windows with p(object) above this are accepted (D); null: the most likely class (P)"),
    ] = 0.08
    min_windows: Annotated[
        WholeNumber,
        Doc(
            "if fewer are, the most probable up to this number are accepted too, but none that is "
            "less than a tenth as probable as the first (D; P: 0)"
        ),
    ] = 8
    square_side: Annotated[
        PositiveOrNone,
        Doc(
            "side, in diameters, of the squares around the windows' centres that make up the "
            "region (D); null: the windows themselves (P)"
        ),
    ] = 0.7
    scan: Annotated[
        Literal["exact", "fast"],
        Doc(
            "windows that are classified: all (exact, P), or every other one that is not on a "
            "large plane, once for object sizes up to a quarter apart (fast, D)"
        ),
    ] = "fast"


@dataclass(frozen=True)
class CloserLookSettings(Settings):
    """How much of a region is searched first, and what if that gave no right pose."""

    first_area: Annotated[
        PositiveOrNone,
        Doc(
            "a larger region is searched first in the squares of its likeliest windows, up to this "
            "area (squared diameters; times the instances that are looked for, if their number is "
            "not known) (D); null: the whole region (P)"
        ),
    ] = 6.0

    places: Annotated[
        CountOrNone,
        Doc(
            "likeliest places that are searched if no pose is probably right; with colours, all "
            "if the object is known to be there, at most 9 if not (D); null: none (P)"
        ),
    ] = 12
    places_at_once: Annotated[Count, Doc("places that are searched at once (D)")] = 3
    side: Annotated[
        Positive, Doc("side, in diameters, of the square around a place that is searched (D)")
    ] = 1.2


def candidate_region(
    object_id: int,
    windows: Windows,
    probabilities: Values,
    is_best: Flags,
    shape: tuple[int, int],
    extent: float,
    settings: RegionSettings,
) -> Region:
    """Union of the accepted windows, or of squares around their centres (paper, section 3.1).

    `is_best` is True where the object is the arg-max class. `extent` is the object's diameter in
    units of the windows' metric size: a long object may extend beyond the union of its windows.
    """
    accepted = is_best if settings.threshold is None else probabilities > settings.threshold
    if accepted.sum() < settings.min_windows and len(probabilities):
        order = np.argsort(-probabilities, kind="stable")[: settings.min_windows]
        comparable = probabilities[order] >= _COMPARABLE * probabilities.max()
        accepted = accepted.copy()
        accepted[order[comparable]] = True
    scale = 1.0 if settings.square_side is None else settings.square_side * extent
    half_sides = windows.sides[accepted] * scale / 2
    mask = union_of_squares(windows.centers[accepted], half_sides, shape)
    return Region(object_id, windows.centers, probabilities, mask)


def region_weights(region: Region, pixels: Positions, radii: Values) -> Values:
    """Weights, 0.01…1, of pixels (x, y): how probable it is that they show the region's object.

    The largest probability among the windows whose centres are within `radii` px, half the object's
    extent. Patches near windows of low probability should not outvote those near likely ones.
    """
    order = np.argsort(-region.probabilities)[: np.sum(region.probabilities > _MIN_WEIGHT)]
    windows = region.centers[order], region.probabilities[order]
    weights = np.full(len(pixels), _MIN_WEIGHT, windows[1].dtype).astype(np.float64)
    of = pixels, radii, *windows, weights
    _fill_from_likeliest(*(np.ascontiguousarray(part, np.float64) for part in of))
    return weights


@compiled_ahead()
def _fill_from_likeliest(
    pixels: Positions, radii: Values, centers: Positions, likely: Values, weights: Values
) -> None:
    """Fill the weights of pixels with a window near enough; the likeliest windows come first."""
    for i in range(len(pixels)):
        for k in range(len(centers)):
            dx, dy = pixels[i, 0] - centers[k, 0], pixels[i, 1] - centers[k, 1]
            if dx * dx + dy * dy <= radii[i] * radii[i]:
                weights[i] = likely[k]
                break


def union_of_squares(centers: Positions, half_sides: Values, shape: tuple[int, int]) -> Mask:
    """Pixels within any square."""
    mask = np.zeros(shape, dtype=bool)
    first = np.maximum(np.rint(centers - half_sides[:, None]), 0).astype(int).tolist()
    end = np.maximum(np.rint(centers + half_sides[:, None]) + 1, 0).astype(int).tolist()
    for (left, top), (right, bottom) in zip(first, end, strict=True):
        mask[top:bottom, left:right] = True
    return mask


def first_region(
    region: Region,
    radii: Values,
    square_side: float,
    settings: CloserLookSettings,
    instances: int = 1,
) -> Region:
    """The likeliest part of a region that is larger than `first_area` for each of the `instances`.

    As many of the likeliest windows as cover that area by their squares, of `square_side`
    diameters, at least one. `radii` are half the object's diameter in pixels, at the depth of each
    of the region's windows; that of the likeliest window is the unit of the area.
    """
    order = np.argsort(-region.probabilities, kind="stable")
    if settings.first_area is None or len(order) == 0:
        return region
    largest = settings.first_area * instances * (2.0 * radii[order[0]]) ** 2
    if np.count_nonzero(region.mask) <= largest:
        return region
    centers, half_sides = region.centers[order], radii[order] * square_side

    def covered(count: int) -> float:
        """Area (px) of the first squares, measured on a grid of `_COARSE` px."""
        height, width = (-(-side // _COARSE) for side in region.mask.shape)
        # A square covers its last cell as well.
        half = half_sides[:count] / _COARSE - 0.5
        cells = union_of_squares(centers[:count] / _COARSE, half, (height, width))
        return float(np.count_nonzero(cells)) * _COARSE**2

    # The area grows with the number of squares, so that it can be bisected.
    count = bisect_right(range(len(order) + 1), largest, lo=2, key=covered) - 1
    mask = union_of_squares(centers[:count], half_sides[:count], region.mask.shape)
    return replace(region, mask=mask & region.mask)


def likely_regions(
    region: Region, radii: Values, settings: CloserLookSettings, known: bool, colored: bool
) -> Iterator[Region]:
    """Regions of a few places each, the likeliest places first.

    `known`: the object is in the image, so that less likely places count, too; all of them, if it
    has colours. `radii` are half its diameter in pixels, at the depth of each window.
    """
    most = settings.places or 0
    if colored and most > 0:
        most = len(radii) if known else min(most, _MOST_UNKNOWN)
    rows = likely_places(region, radii, most, _LEAST if known else _LEAST_UNKNOWN)
    for start in range(0, len(rows), settings.places_at_once):
        chosen = rows[start : start + settings.places_at_once]
        half_sides = radii[chosen] * settings.side
        mask = union_of_squares(region.centers[chosen], half_sides, region.mask.shape)
        yield replace(region, mask=mask)


def likely_places(region: Region, radii: Values, most: int, least: float) -> Rows:
    """The likeliest windows with p(object) > `least`, none within the radius of a likelier one."""
    left = region.probabilities.astype(np.float64)
    rows: list[int] = []
    while len(rows) < most and len(left) and left.max() > least:
        row = int(left.argmax())
        rows.append(row)
        offsets = np.linalg.norm(region.centers - region.centers[row], axis=1)
        left[offsets < radii[row]] = 0.0
    return np.array(rows, dtype=np.int64)


def object_radii(frame: Frame, pixels: Positions, model: ObjectModel) -> Values:
    """Half the object's diameter in pixels, at the depth of each of the pixels (x, y)."""
    depths = center_depths(frame.depth, np.rint(pixels).astype(np.int64))
    return np.asarray(frame.camera_matrix[0, 0] * model.diameter / np.maximum(depths, _NEAREST) / 2)


def patch_pixels(
    frame: Frame, region: Region, model: ObjectModel, grid: GridSettings, share: float = 1.0
) -> Pixels:
    """Centres (x, y) of a share of a region's patches; of too many, more at likely windows."""
    pixels = region_pixels(region.mask, grid.step)
    radii = object_radii(frame, pixels, model)
    weights = region_weights(region, pixels.astype(np.float64), radii)
    chosen = thin_out(weights, grid.max_patches)
    if share < 1.0:
        chosen = chosen[thin_out(weights[chosen], round(share * len(chosen)))]
    return np.asarray(pixels[chosen])


def region_pixels(mask: Mask, step: int) -> Pixels:
    """Grid pixels (x, y), every `step` px, inside a candidate region."""
    grid = pixel_grid((mask.shape[0], mask.shape[1]), step)
    return np.asarray(grid[mask[grid[:, 1], grid[:, 0]]])


def thin_out(weights: Values, count: int) -> Rows:
    """Indices of at most `count` items, in order, spread with a density that follows the weights.

    Item i is chosen with a share of min(1, c·w_i), c such that they add up to `count`, at even
    steps of the running total (systematic sampling). Weights are positive.
    """
    if len(weights) <= count:
        return np.arange(len(weights))
    share = np.minimum(1.0, weights * (count / weights.sum()))
    for _ in range(_ROUNDS):  # what whole shares leave over goes to the others
        part = share < 1.0
        rest = count - np.count_nonzero(~part)
        share[part] = np.minimum(1.0, share[part] * (rest / share[part].sum()))
    steps = np.floor(np.cumsum(share) + 0.5).astype(int)
    return np.asarray(np.flatnonzero(np.diff(steps, prepend=0) > 0)[:count])
