"""Names of outputs: every declared value changes them, order and undeclared keys cannot."""

import copy
import dataclasses
import json
from typing import Any

import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from generated_values import json_values, texts
from hlp.errors import ConfigError
from hlp.method.settings import MethodSettings
from hlp.settings import read_settings
from hlp.source_code import Code
from hlp.stages.fingerprint import fingerprint, is_fingerprint

CODE = Code("0123", {"numpy": "2.4.6"})
TREES = st.dictionaries(texts(), json_values(), max_size=5)


def name_of(settings: Any, **other: Any) -> str:
    inputs = {"stage": "codebook", "code": CODE, "seed": 0, "upstream": {"views": "ab"}, **other}
    return fingerprint(settings=settings, **inputs)


def shuffled(value: Any, draw: st.DataObject) -> Any:
    """The same with the keys of its objects in another order."""
    if isinstance(value, dict):
        names = draw.draw(st.permutations(list(value)))
        return {name: shuffled(value[name], draw) for name in names}
    return [shuffled(each, draw) for each in value] if isinstance(value, list) else value


@given(TREES, TREES, st.data())
def test_settings_have_one_name_exactly_if_they_say_the_same(first, second, data):
    assert is_fingerprint(name_of(first))
    assert name_of(shuffled(first, data)) == name_of(first)
    same = json.dumps(first, sort_keys=True) == json.dumps(second, sort_keys=True)
    assert (name_of(first) == name_of(second)) == same


@given(TREES, texts(), json_values())
def test_one_more_or_another_value_is_another_name(tree, key, value):
    other = {**tree, key: value}
    assume(json.dumps(other, sort_keys=True) != json.dumps(tree, sort_keys=True))
    assert name_of(other) != name_of(tree)
    assert name_of(tree, upstream=other | {"views": "ab"}) != name_of(tree)
    assert name_of(tree, seed=1) != name_of(tree)


def places(tree: Any, path: tuple[str, ...] = ()) -> list[tuple[str, ...]]:
    """Paths of the objects in a tree."""
    if not isinstance(tree, dict):
        return []
    inner = [place for name in tree for place in places(tree[name], (*path, name))]
    return [path, *inner]


DEFAULTS = dataclasses.asdict(MethodSettings())


@given(st.sampled_from(places(DEFAULTS)), texts(), json_values())
def test_a_key_that_no_setting_declares_is_an_error_that_names_it(place, key, value):
    content = copy.deepcopy(DEFAULTS)
    inside = content
    for name in place:
        inside = inside[name]
    assume(key not in inside)
    inside[key] = value
    with pytest.raises(ConfigError) as caught:
        read_settings(MethodSettings, content)
    assert ".".join((*place, key)) in str(caught.value)


def test_the_method_s_settings_come_back_from_json():
    written = json.loads(json.dumps(DEFAULTS))
    assert read_settings(MethodSettings, written) == MethodSettings()
