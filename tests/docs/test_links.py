"""Files, tests and modules that the pages name are there."""

import pkgutil
import re

import pytest
from markdown_pages import PAGES, ROOT, links

# Written when the site is built; test_site.py checks them there.
GENERATED = ("docs/configuration/", "docs/command-line.md", "docs/notebooks/")
NAMED = [*PAGES, ROOT / "CONTRIBUTING.md"]
TESTS = re.compile(r"\btests/[\w/]+(?:\.py)?")
MODULES = re.compile(r"(?:`|::: )(hlp\.[\w.]+)")


@pytest.mark.parametrize("path", PAGES, ids=lambda path: path.relative_to(ROOT).as_posix())
def test_relative_links_point_to_files(path):
    missing = []
    for link in links(path):
        target = link.partition("#")[0]
        if "://" in link or not target:
            continue
        file = (path.parent / target).resolve()
        if not file.exists() and not str(file.relative_to(ROOT)).startswith(GENERATED):
            missing.append(link)
    assert not missing


@pytest.mark.parametrize("path", NAMED, ids=lambda path: path.relative_to(ROOT).as_posix())
def test_tests_and_modules_that_are_named_exist(path):
    text = path.read_text()
    assert [name for name in TESTS.findall(text) if not (ROOT / name).exists()] == []
    for name in MODULES.findall(text):
        pkgutil.resolve_name(name.rstrip("."))


def test_links_are_seen():
    assert "method.md" in set(links(ROOT / "docs" / "index.md"))
    assert "demo_panels.jpg" in set(links(ROOT / "docs" / "index.md"))
