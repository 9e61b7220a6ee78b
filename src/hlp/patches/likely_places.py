"""A closer look at a frame: the likely places of an object, a few at a time.

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

_LEAST = 0.02  # p(object): where it is lower, the classifier hardly ever errs


@dataclass(frozen=True)
class CloserSettings(Settings):
    """Where else an object is looked for if its region gave no right pose."""

    places: Annotated[
        int,
        Ge(0),
        Doc("most likely places that are searched if no pose is probably right (D); 0: none (P)"),
    ] = 12
    together: Annotated[int, Ge(1), Doc("places that are searched at once (D)")] = 3
    side: Annotated[
        float, Gt(0), Doc("side, in diameters, of the square around a place that is searched (D)")
    ] = 1.2


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
