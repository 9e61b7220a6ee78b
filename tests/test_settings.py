"""Settings from plain values: strict, with defaults, and every mistake named by its key."""

import json
import pickle
from dataclasses import asdict, dataclass, field
from typing import Annotated, Any, Literal

import pytest
from annotated_types import Ge, Gt, Interval, Le, Len

from hlp.errors import ConfigError, DataError
from hlp.settings import Doc, Registry, Settings, SettingsError, Stored, read_settings, stored_as

TOOLS: Registry[Any] = Registry("tool", "hlp.voting")


@TOOLS.register
@dataclass(frozen=True)
class Hammer(Settings):
    name: Literal["hammer", "mallet"] = "hammer"
    weight: Annotated[float, Gt(0), Doc("kg")] = 1.0


@TOOLS.register
@dataclass(frozen=True)
class Saw(Settings):
    name: Literal["saw"] = "saw"
    teeth: Annotated[int, Ge(1)] = 30

    def __post_init__(self):
        super().__post_init__()
        if self.teeth % 2:
            raise SettingsError("teeth", f"is {self.teeth}: it must be even")


@dataclass(frozen=True, kw_only=True)
class Bench(Settings):
    place: str
    height: Annotated[int | None, Ge(1)] = None
    share: Annotated[float, Interval(ge=0, le=1)] = 0.5
    sides: tuple[Annotated[int, Ge(1)], ...] = (2, 3)
    limits: tuple[Annotated[float, Ge(0)], Annotated[float, Gt(1)]] = (0.0, 2.0)
    given: str | list[float] = "file"
    used: bool = True
    any: dict[str, Any] = field(default_factory=dict)
    tool: Annotated[Any, TOOLS] = field(default_factory=Hammer)
    more: dict[str, Annotated[Any, TOOLS]] = field(default_factory=dict)
    kept: Hammer | None = field(default_factory=Hammer)


FULL = {
    "place": "attic",
    "height": 3,
    "share": 1,
    "sides": [4],
    "limits": [1, 3.5],
    "given": [1.5, 2],
    "used": False,
    "any": {"deep": [1, {"er": None}]},
    "tool": {"name": "saw", "teeth": 8},
    "more": {"first": {"name": "mallet", "weight": 2}, "second": {"name": "saw"}},
    "kept": None,
}


def test_plain_values_become_settings_and_come_back_through_json():
    bench = read_settings(Bench, FULL)
    assert bench.sides == (4,) and bench.limits == (1.0, 3.5) and bench.given == [1.5, 2.0]
    assert isinstance(bench.share, float) and bench.kept is None
    assert bench.tool == Saw(teeth=8)
    assert bench.more == {"first": Hammer("mallet", 2.0), "second": Saw()}
    assert read_settings(Bench, json.loads(json.dumps(asdict(bench)))) == bench


def test_what_is_left_out_has_its_default():
    assert read_settings(Bench, {"place": "attic"}) == Bench(place="attic")
    assert read_settings(Bench, {"place": "attic", "tool": {"name": "hammer"}}).tool == Hammer()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"place": 3}, "b.place is 3: it must be text"),
        ({"height": 0}, "b.height is 0: it must be at least 1"),
        ({"height": True}, "b.height is True: it must be a whole number or null"),
        ({"height": "3"}, "b.height is '3': it must be a whole number or null"),
        ({"share": 1.5}, "b.share is 1.5: it must be at most 1"),
        ({"share": float("nan")}, "b.share is nan: it must be a finite number"),
        ({"sides": [4, 0]}, "b.sides.1 is 0: it must be at least 1"),
        ({"sides": [4, "a"]}, "b.sides.1 is 'a': it must be a whole number"),
        ({"sides": 4}, "b.sides is 4: it must be a list"),
        ({"limits": [1]}, "b.limits is [1]: it must be a list of 2"),
        ({"limits": [1, 2, 3]}, "b.limits is [1, 2, 3]: it must be a list of 2"),
        ({"limits": [1, 1]}, "b.limits.1 is 1: it must be above 1"),
        ({"given": 4}, "b.given is 4: it must be text or a list"),
        ({"used": 1}, "b.used is 1: it must be true or false"),
        ({"kept": 4}, "b.kept is 4: it must be a mapping of keys to values or null"),
        ({"kept": {"weight": -1}}, "b.kept.weight is -1: it must be above 0"),
        ({"tool": {"teeth": 8}}, "b.tool.name is not set: set b.tool.name=VALUE"),
        ({"tool": {"name": "axe"}}, "b.tool.name is 'axe': choose one of hammer, mallet, saw"),
        (
            {"tool": {"name": "saw", "weight": 1}},
            "b.tool.weight is not a key: there are name, teeth",
        ),
        ({"tool": {"name": "saw", "teeths": 1}}, "b.tool.teeths is not a key: did you mean teeth?"),
        ({"tool": {"name": "saw", 3: 4}}, "b.tool.3 is not a key: there are name, teeth"),
        ({"tool": {"name": "saw", "teeth": 7}}, "b.tool.teeth is 7: it must be even"),
        (
            {"more": {"x": {"name": "saw", "teeth": 0}}},
            "b.more.x.teeth is 0: it must be at least 1",
        ),
    ],
)
def test_a_mistake_is_named_by_its_key(change, message):
    with pytest.raises(ConfigError) as caught:
        read_settings(Bench, FULL | change, "b")
    assert str(caught.value) == message


def test_a_required_key_is_asked_for():
    with pytest.raises(ConfigError, match=r"^place is not set: set place=VALUE$"):
        read_settings(Bench, {})


def test_ranges_and_choices_hold_in_python_too():
    with pytest.raises(SettingsError, match=r"^weight is 0: it must be above 0$"):
        Hammer(weight=0)
    with pytest.raises(SettingsError, match=r"^weight is nan: it must be a finite number$"):
        Hammer(weight=float("nan"))
    with pytest.raises(SettingsError, match=r"^name is 'axe': it must be 'hammer' or 'mallet'$"):
        Hammer(name="axe")  # type: ignore[arg-type]
    for height in (0, 1.5, True):
        with pytest.raises(ValueError, match=f"height is {height}: it must be"):
            Bench(place="attic", height=height)  # type: ignore[arg-type]


def test_an_error_survives_the_way_from_a_worker():
    error = pickle.loads(pickle.dumps(SettingsError("a.b", "is 3: it must be 4")))
    assert (str(error), error.key) == ("a.b is 3: it must be 4", "a.b")


@pytest.mark.parametrize(
    ("values", "said"),
    [
        ({"height": 10**9}, "height is 1000000000: it must be at most 1e+06"),
        ({"height": 10**400}, "height is 1000"),
        ({"limits": [0.0, float("inf")]}, "limits.1 is inf: it must be a finite number"),
        ({"limits": [0.0, 1e9]}, "limits.1 is 1000000000.0: it must be at most 1e+06"),
        ({"limits": [0.0, 10**400]}, "limits.1 is 1000"),
        ({"tool": {"name": "hammer", "weight": float("inf")}}, "tool.weight is inf"),
    ],
)
def test_numbers_are_finite_and_of_a_size_that_fits(values, said):
    with pytest.raises(SettingsError, match=said.replace("+", r"\+")):
        read_settings(Bench, {"place": "attic", **values})


def test_lengths_and_angles_are_bounded_by_their_names():
    @dataclass(frozen=True)
    class Cone(Settings):
        half_deg: float = 10.0
        far_mm: Annotated[float, Le(2e5)] = 10.0
        near_mm: float = 1.0

    assert Cone(-360.0, 2e5, 1e5) == Cone(-360.0, 2e5, 1e5)
    with pytest.raises(SettingsError, match=r"half_deg is -361\.0: it must be at least -360"):
        Cone(-361.0)
    with pytest.raises(SettingsError, match=r"near_mm is 200000\.0: it must be at most 100000"):
        Cone(10.0, 2e5, 2e5)


@dataclass(frozen=True)
class Part(Stored):
    sizes: Annotated[tuple[float, ...], Len(2, 2), lambda sizes: sizes or [1, 2]]
    name: str = "plain"


def test_what_a_file_holds_is_read_without_what_is_not_declared():
    assert stored_as(list[Part], [{"sizes": [], "more": 1}], "a.json") == [Part((1.0, 2.0))]
    assert stored_as(dict[str, Part], {"x": {"sizes": [3, 4], "name": "y"}}, "a.json") == {
        "x": Part((3.0, 4.0), "y")
    }


@pytest.mark.parametrize(
    ("kind", "content", "said"),
    [
        (Part, [1], "the content is [1]: it must be a mapping of keys to values"),
        (Part, {}, "sizes is missing"),
        (list[Part], {}, "the content is {}: it must be a list"),
        (list[Part], [None], "0 is null: it must be a mapping of keys to values"),
        (list[Part], [{"sizes": [1, 2]}, {"sizes": [1]}], "1.sizes is [1]: it must be a list of 2"),
        (dict[str, Part], {"x": {"sizes": [1, "2"]}}, "x.sizes.1 is '2': it must be a number"),
    ],
)
def test_what_is_wrong_in_a_file_is_named(kind, content, said):
    with pytest.raises(DataError) as caught:
        stored_as(kind, content, "a.json")
    assert str(caught.value) == f"a.json: {said}"
