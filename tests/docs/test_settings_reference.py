import dataclasses
from dataclasses import dataclass, field
from typing import Annotated, Literal, get_type_hints

import pytest
from annotated_types import Ge, Gt, Interval, Le, Lt
from omegaconf import OmegaConf

from hlp.commands.composing import compose_config
from hlp.config.settings import RunSettings
from hlp.settings import Doc


@dataclass(frozen=True)
class Inner:
    """What is inside."""

    size_px: Annotated[int, Ge(8), Doc("Side of the\n   image.")] = 64


@dataclass(frozen=True)
class Outer:
    """Config group `things`: everything at once.

    More about it.
    """

    name: Literal["outer"]
    plain: int
    angle_deg: Annotated[float, Gt(0), Lt(180)] = 5.0
    share: Annotated[float, Interval(ge=0, le=1)] = 0.25
    limit: Annotated[int | None, Doc("None | all")] = None
    pulled: Annotated[float, Gt(0), Doc("Pull.")] = 2.8
    speed: Annotated[float, Ge(0), Le(3)] = 1.0
    widths: tuple[int, ...] = (16, 32)
    between: tuple[int, int] = (5, 8)
    used: bool = True
    inner: Inner = field(default_factory=lambda: Inner(size_px=48))
    others: dict[str, Inner] = field(default_factory=dict)
    made: int = field(default=0, init=False)


@pytest.fixture(scope="module")
def keys(settings_reference):
    tables = settings_reference.tables_of(Outer, "things.")
    return {key.name: key for table in tables for key in table.keys}


@pytest.mark.parametrize(
    ("name", "kind", "default", "unit", "limits", "description"),
    [
        ("name", "`outer`", "", "", "", ""),
        ("plain", "integer", "", "", "", ""),
        ("angle_deg", "number", "`5.0`", "°", "> 0, < 180", ""),
        ("share", "number", "`0.25`", "", "≥ 0, ≤ 1", ""),
        ("limit", "integer or null", "`null`", "", "", "None | all"),
        ("pulled", "number", "`2.8`", "", "> 0", "Pull."),
        ("speed", "number", "`1.0`", "", "≥ 0, ≤ 3", ""),
        ("widths", "list of integer", "`[16, 32]`", "", "", ""),
        ("between", "list of 2: integer, integer", "`[5, 8]`", "", "", ""),
        ("used", "true or false", "`true`", "", "", ""),
        ("inner.size_px", "integer", "`48`", "px", "≥ 8", "Side of the image."),
        ("others.NAME.size_px", "integer", "`64`", "px", "≥ 8", "Side of the image."),
    ],
)
def test_a_field_becomes_a_row(keys, name, kind, default, unit, limits, description):
    row = keys[f"things.{name}"]
    assert dataclasses.astuple(row)[1:] == (kind, default, unit, limits, description)


def test_nested_records_have_tables_of_their_own(settings_reference, keys):
    tables = settings_reference.tables_of(Outer, "things.")
    assert [table.title for table in tables] == ["Outer", "Inner", "Inner"]
    assert not keys.keys() & {"things.inner", "things.made"}


def test_a_table_in_markdown(settings_reference):
    text = settings_reference.as_markdown(
        settings_reference.tables_of(Outer, "things.")[0], "## Things"
    )
    assert text.startswith("## Things\n\nEverything at once.\n\nMore about it.\n\n| Key | Type |")
    assert "None \\| all" in text  # a bar would end the cell
    widths = {line.replace("\\|", "").count("|") for line in text.splitlines() if line[:1] == "|"}
    assert widths == {7}
    plain = dataclasses.make_dataclass("Plain", [("count", int)], frozen=True)
    text = settings_reference.as_markdown(settings_reference.tables_of(plain, "")[0], "#")
    assert "| Key | Type |\n" in text  # columns that say nothing are left out


def test_every_key_of_the_default_configuration_is_listed(settings_reference):
    config = OmegaConf.to_container(compose_config("output=out"), resolve=True)
    listed = {
        key.name
        for name, hint in get_type_hints(RunSettings, include_extras=True).items()
        for kind in settings_reference.settings_classes(hint)
        for table in settings_reference.tables_of(kind, f"{name}.")
        for key in table.keys
    }
    listed |= {key.name for key in settings_reference.tables_of(RunSettings, "")[0].keys}
    # A group whose class does not keep the name of its file has no row for it.
    missing = {key for key in leaves(config) if key not in listed and not key.endswith(".name")}
    assert not missing


def leaves(values, prefix=""):
    for key, value in values.items():
        if isinstance(value, dict) and value:
            yield from leaves(value, f"{prefix}{key}.")
        else:
            yield f"{prefix}{key}"
