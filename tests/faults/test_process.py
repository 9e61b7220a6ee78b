"""What the other tests of this folder rely on."""

import pkgutil

import pytest
from process import COMMAND_PLACES, LEARNING_PLACES, PLACES, SWEEP_PLACES


@pytest.mark.parametrize("places", [PLACES, LEARNING_PLACES, COMMAND_PLACES, SWEEP_PLACES])
def test_every_place_is_a_function(places):
    for module, name, _ in places.values():
        assert callable(getattr(pkgutil.resolve_name(module), name))
