"""Fixtures of the tests that read data sets."""

import numpy as np
import pytest

from hlp.objects import near_symmetries
from hlp.objects.near_symmetries import NearSymmetries


@pytest.fixture
def no_near_symmetries(monkeypatch: pytest.MonkeyPatch) -> None:
    """None are looked for, which takes a second for each object; tests/objects tests that."""
    nothing = NearSymmetries(np.zeros((0, 4, 4)), np.zeros((0, 4, 4)))
    monkeypatch.setattr(near_symmetries, "find_near_symmetries", lambda mesh, diameter: nothing)
