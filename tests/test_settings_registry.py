"""Alternatives are found by their names, here and in plug-ins; nothing else is imported."""

import importlib.metadata
import sys
from dataclasses import dataclass
from importlib.metadata import EntryPoint
from typing import Literal

import pytest

from hlp.errors import ConfigError


@dataclass(frozen=True)
class Red:
    name: Literal["red", "crimson"] = "red"


@pytest.fixture
def package(tmp_path, monkeypatch):
    """A package with an alternative `green` and, beside it, a module that must not be imported."""
    folder = tmp_path / "colours_of_a_test"
    folder.mkdir()
    (folder / "__init__.py").write_text(
        "from hlp.settings import Registry\nCOLOURS = Registry('colour', 'colours_of_a_test')\n"
    )
    (folder / "green.py").write_text(
        "from typing import Literal\nfrom colours_of_a_test import COLOURS\n"
        "@COLOURS.register\nclass Green:\n    name: Literal['green'] = 'green'\n"
    )
    (folder / "broken.py").write_text("raise RuntimeError('imported')\n")
    monkeypatch.syspath_prepend(tmp_path)
    yield folder.name
    for name in [module for module in sys.modules if module.startswith(folder.name)]:
        del sys.modules[name]


def colours(package):
    return __import__(package).COLOURS


def test_what_is_registered_is_found_without_any_import(package):
    known = colours(package)
    known.register(Red)
    assert known.find("red") is known.find("crimson") is Red
    assert f"{package}.green" not in sys.modules


def test_a_module_named_like_the_alternative_is_imported_before_the_others(package):
    assert colours(package).find("green").__name__ == "Green"
    assert f"{package}.broken" not in sys.modules


def test_a_bug_in_a_module_is_no_unknown_name(package):
    with pytest.raises(RuntimeError, match="imported"):
        colours(package).find("blue")


def test_an_unknown_name_is_told_with_the_group_and_the_names_there_are(package, tmp_path):
    (tmp_path / package / "broken.py").write_text("")
    known = colours(package)
    known.register(Red)
    message = r"^colour\.name is 'blue': choose one of crimson, green, red$"
    with pytest.raises(ConfigError, match=message):
        known.find("blue")
    with pytest.raises(ConfigError, match=r"^task\.paint\.name is 'blue'"):
        known.find("blue", "task.paint")
    assert list(known.alternatives()) == ["crimson", "green", "red"]


def test_two_classes_of_one_name_are_refused(package):
    known = colours(package)
    known.register(Red)
    known.register(Red)  # a module that is loaded again

    @dataclass(frozen=True)
    class Other:
        name: Literal["red"] = "red"

    with pytest.raises(ConfigError, match=r"^colour: both .*Red and .*Other are named 'red'$"):
        known.register(Other)


def test_a_plug_in_that_cannot_be_loaded_is_named(package, tmp_path, monkeypatch):
    (tmp_path / package / "broken.py").write_text("")
    plug_in = EntryPoint("paint", "no_such_paint", "hlp.colour")
    monkeypatch.setattr(importlib.metadata, "entry_points", lambda group: [plug_in])
    with pytest.raises(ModuleNotFoundError) as caught:
        colours(package).find("blue")
    assert caught.value.__notes__ == ["while loading the plug-in no_such_paint (hlp.colour)"]
