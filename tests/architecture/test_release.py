"""What a release says about itself: its extras and their exact versions, and how to cite it."""

import re
import tomllib
from pathlib import Path

import pytest
import yaml
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

import hlp

ROOT = Path(__file__).parents[2]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
EXTRAS = PROJECT["optional-dependencies"]
NOT_PINNED = {"ray": "its 70 MB are for clusters alone; none of the tests starts one"}
"""Packages of extras without an exact version, and why."""


def pinned() -> dict[str, str]:
    """The exact versions of constraints.txt, by canonical name."""
    lines = (ROOT / "constraints.txt").read_text().splitlines()
    pairs = [line.split("==") for line in lines if line and not line.startswith("#")]
    return {canonicalize_name(name): version for name, version in pairs}


@pytest.mark.parametrize("extra", ["", *EXTRAS])
def test_exact_versions_are_in_the_ranges_of_an_extra(extra: str) -> None:
    versions = pinned()
    for line in EXTRAS[extra] if extra else PROJECT["dependencies"]:
        requirement = Requirement(line)
        name = canonicalize_name(requirement.name)
        if name not in NOT_PINNED:
            assert name in versions, f"{line} has no exact version in constraints.txt"
            assert versions[name] in requirement.specifier, f"{line}: {versions[name]} is tested"


def test_what_is_not_pinned_belongs_to_an_extra() -> None:
    named = {canonicalize_name(Requirement(line).name) for all_ in EXTRAS.values() for line in all_}
    assert {*NOT_PINNED} <= named - {*pinned()}


def test_ranges_of_dev_are_those_of_the_extra_that_it_repeats() -> None:
    ranges = {Requirement(line).name: line for line in EXTRAS["dev"]}
    for extra, lines in EXTRAS.items():
        for line in lines if extra != "dev" else ():
            assert ranges.get(Requirement(line).name, line) == line, f"{extra}: {line}"


def test_errors_name_extras_that_there_are() -> None:
    """`pip install 'hlp[EXTRA]'` stands in messages and in the help of commands."""
    sources = [path.read_text() for path in (ROOT / "src").rglob("*.py")]
    named = {name for text in sources for name in re.findall(r"hlp\[(\w+)\]", text)}
    assert named and named <= {*EXTRAS}


def test_the_citation_has_what_its_format_requires() -> None:
    cited = yaml.safe_load((ROOT / "CITATION.cff").read_text())
    assert {"cff-version", "message", "title", "authors"} <= {*cited}
    assert cited["cff-version"] == "1.2.0"
    assert str(cited["version"]) == hlp.__version__
    paper = cited["preferred-citation"]
    assert {"type", "title", "authors"} <= {*paper}
    names = [f"{author['given-names']} {author['family-names']}" for author in paper["authors"]]
    assert names == ["Haoruo Zhang", "Qixin Cao"]
