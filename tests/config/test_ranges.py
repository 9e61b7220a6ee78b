import dataclasses
import math
from dataclasses import dataclass

import pytest

from hlp.config.ranges import check_ranges


@dataclass(frozen=True)
class Inner:
    step: int
    tau_mm: float


@dataclass(frozen=True)
class Outer:
    seed: int
    recentre: bool
    in_plane_min_deg: float
    frames: int | None
    name: str
    grid: Inner
    each: dict[str, Inner]
    windows: dict[str, str]


GOOD = Outer(0, False, -45.0, None, "x", Inner(1, 0.0), {"cat": Inner(1, 1.0)}, {"a": "b"})


def test_sound_settings_pass() -> None:
    check_ranges(GOOD)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"seed": -1}, "seed is -1: it must be at least 0"),
        ({"frames": 0}, "frames is 0: it must be at least 1"),
        ({"grid": Inner(0, 1.0)}, r"grid\.step is 0: it must be at least 1"),
        ({"grid": Inner(8, -2.5)}, r"grid\.tau_mm is -2\.5: it must be at least 0"),
        ({"each": {"cat": Inner(1, 1.0), "cup": Inner(0, 1.0)}}, r"each\.cup\.step is 0: .*"),
        ({"grid": Inner(8, math.nan)}, r"grid\.tau_mm is nan: it must be at least 0"),
    ],
)
def test_impossible_numbers_are_named(change: dict[str, object], message: str) -> None:
    with pytest.raises(ValueError, match=f"^{message}$"):
        check_ranges(dataclasses.replace(GOOD, **change))  # type: ignore[arg-type]
