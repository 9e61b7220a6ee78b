"""Where an object is looked for first, and closer looks at its likely places, a few at a time.

A classifier that knows few objects accepts windows all over a cluttered image. The patches of such
a region lie far apart, and a hidden object gets too few votes. Its place is then still among the
likeliest: searched beside few others, it gets as many votes as in a small region.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np
from annotated_types import Ge, Gt
from jaxtyping import Float, Int

from hlp.patches.holistic import union_of_squares
from hlp.records import Region
from hlp.settings import Doc, Settings

_COARSE = 4  # px
_LEAST = 0.02  # p(object): where it is lower, the classifier hardly ever errs


@dataclass(frozen=True)
class CloserSettings(Settings):
    """How much of a region is searched first, and what if that gave no right pose."""

    first_area: Annotated[
        float,
        Ge(0),
        Doc(
            "of a larger region only the likeliest windows' squares are searched first, up to this "
            "area in squared diameters of the object, for each instance that may be there where "
            "their number is not known (D); 0: the whole region (P)"
        ),
    ] = 6.0

    places: Annotated[
        int,
        Ge(0),
        Doc("most likely places that are searched if no pose is probably right (D); 0: none (P)"),
    ] = 12
    together: Annotated[int, Ge(1), Doc("places that are searched at once (D)")] = 3
    side: Annotated[
        float, Gt(0), Doc("side, in diameters, of the square around a place that is searched (D)")
    ] = 1.2


def first_region(
    region: Region,
    radii: Float[np.ndarray, "n"],
    square_side: float,
    settings: CloserSettings,
    instances: int = 1,
) -> Region:
    """The likeliest part of a region that is larger than `first_area` for each of the `instances`.

    As many of the likeliest windows as cover that area by their squares, of `square_side`
    diameters, at least one. `radii` are half the object's diameter in pixels, at the depth of each
    of the region's windows; that of the likeliest window is the unit of the area.
    """
    order = np.argsort(-region.probabilities, kind="stable")
    if settings.first_area == 0 or len(order) == 0:
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
    least, most = 1, len(order)
    while least < most:
        middle = (least + most + 1) // 2
        least, most = (middle, most) if covered(middle) <= largest else (least, middle - 1)
    mask = union_of_squares(centers[:least], half_sides[:least], region.mask.shape)
    return replace(region, mask=mask & region.mask)


def likely_regions(
    region: Region, radii: Float[np.ndarray, "n"], settings: CloserSettings
) -> Iterator[Region]:
    """Regions of a few places each, the likeliest places first.

    `radii` are half the object's diameter in pixels, at the depth of each of the region's windows.
    """
    rows = likely_places(region, radii, settings.places)
    for start in range(0, len(rows), settings.together):
        chosen = rows[start : start + settings.together]
        half_sides = radii[chosen] * settings.side
        mask = union_of_squares(region.centers[chosen], half_sides, region.mask.shape)
        yield replace(region, mask=mask)


def likely_places(region: Region, radii: Float[np.ndarray, "n"], most: int) -> Int[np.ndarray, "m"]:
    """The region's windows with the highest p(object), none within the radius of a likelier one."""
    left = region.probabilities.astype(np.float64)
    rows: list[int] = []
    while len(rows) < most and len(left) and left.max() > _LEAST:
        row = int(left.argmax())
        rows.append(row)
        offsets = np.linalg.norm(region.centers - region.centers[row], axis=1)
        left[offsets < radii[row]] = 0.0
        left[row] = 0.0
    return np.array(rows, dtype=np.int64)
