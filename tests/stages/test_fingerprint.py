"""Names of outputs: every value changes them; order and undeclared keys cannot."""

import json
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from generated_values import json_values, texts
from hlp.fingerprints import Code
from hlp.stages.manifest import fingerprint, is_fingerprint, plain

BASE = {
    "code": Code("0123", {"numpy": "2.4.6"}),
    "seed": 0,
    "settings": {"encoder": {"width": 32, "levels": [1, 2]}, "k": 3},
    "upstream": {"views": "0123456789abcdef"},
}
TREES = st.dictionaries(texts(), json_values(), max_size=5)


def name_of(**changes):
    return fingerprint("codebook", BASE | changes)


def test_a_name_is_the_same_in_another_process():
    code = (
        "from hlp.fingerprints import Code; from hlp.stages.manifest import fingerprint; "
        f"print(fingerprint('codebook', {BASE!r}))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == name_of() and is_fingerprint(name_of())


@pytest.mark.parametrize(
    "change",
    [
        {"code": Code("0124", {"numpy": "2.4.6"})},
        {"code": Code("0123", {"numpy": "2.4.7"})},
        {"seed": 1},
        {"settings": {"encoder": {"width": 32, "levels": [2, 1]}, "k": 3}},
    ],
    ids=str,
)
def test_every_ingredient_counts(change):
    assert name_of(**change) != name_of()


def shuffled(value, draw):
    """The same with the keys of its objects in another order."""
    if isinstance(value, dict):
        names = draw.draw(st.permutations(list(value)))
        return {name: shuffled(value[name], draw) for name in names}
    return [shuffled(item, draw) for item in value] if isinstance(value, list) else value


@given(TREES, TREES, st.data())
def test_settings_have_one_name_exactly_if_they_say_the_same(first, second, data):
    assert name_of(settings=shuffled(first, data)) == name_of(settings=first)
    same = json.dumps(first, sort_keys=True) == json.dumps(second, sort_keys=True)
    assert (name_of(settings=first) == name_of(settings=second)) == same


@given(TREES, texts(), json_values())
def test_one_more_or_another_value_is_another_name(tree, key, value):
    other = {**tree, key: value}
    assume(json.dumps(other, sort_keys=True) != json.dumps(tree, sort_keys=True))
    assert name_of(settings=other) != name_of(settings=tree)
    assert name_of(settings=tree, upstream=other) != name_of(settings=tree, upstream=tree)


@dataclass(frozen=True)
class Pso:
    particles: int
    step_deg: float


@dataclass(frozen=True)
class Icp:
    particles: int
    step_deg: float


def test_values_have_a_plain_form():
    assert plain(Pso(25, 5.0)) == plain(Pso(25, 5.0)) != plain(Icp(25, 5.0))
    settings = {"k": 3, "encoder": {"levels": (1, 2), "width": np.int64(32)}}
    assert name_of(settings=settings) == name_of()
    given_ = {"a": Path("x") / "y", "b": np.float32(0.5), "c": np.bool_(True)}
    assert plain(given_) == {"a": "x/y", "b": 0.5, "c": True}


@pytest.mark.parametrize("value", [np.zeros(2), {1, 2}, object(), Pso, float("nan")])
def test_what_has_no_plain_form_is_refused(value):
    with pytest.raises((TypeError, ValueError)):
        plain({"bad": [value]})
