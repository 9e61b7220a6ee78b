"""Numbers that no run can work with, found before any stage runs."""

import dataclasses
from collections.abc import Mapping
from typing import Any

MAY_BE_ZERO = frozenset(
    {
        "seed",
        "id",
        "panels",
        "scenes",
        "min_windows",
        "mean_shift_iterations",
        "iterations",
        "patience",
    }
)
"""Whole numbers that may be 0; the others count something that there must be one of at least."""
MAY_BE_NEGATIVE = frozenset({"in_plane_min_deg", "in_plane_max_deg"})


def check_ranges(settings: Any, key: str = "") -> None:
    """Check every number of (nested) settings; raises ValueError naming the key that is wrong."""
    for each in dataclasses.fields(settings):
        value, name = getattr(settings, each.name), f"{key}{each.name}"
        if dataclasses.is_dataclass(value):
            check_ranges(value, f"{name}.")
        elif isinstance(value, Mapping):
            for entry, one in value.items():
                if dataclasses.is_dataclass(one):
                    check_ranges(one, f"{name}.{entry}.")
        elif isinstance(value, int | float) and each.name not in MAY_BE_NEGATIVE:
            whole = isinstance(value, int) and not isinstance(value, bool)
            least = 1 if whole and each.name not in MAY_BE_ZERO else 0
            if not value >= least:  # NaN as well
                raise ValueError(f"{name} is {value}: it must be at least {least}")
