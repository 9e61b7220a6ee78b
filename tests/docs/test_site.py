"""The site builds without a warning and needs no network."""

import os
import re
import subprocess
import sys

import pytest
from markdown_pages import ROOT

import hlp

CONF = ROOT / "conf"
_LOADED = re.compile(r"<(?:script|img|link(?! rel=.canonical))[^>]*(?:src|href)=[\"']?(https?:)?//")

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    pytest.importorskip("mkdocs", reason="the extra docs is not installed")
    folder = tmp_path_factory.mktemp("site")
    sources = os.path.dirname(os.path.dirname(hlp.__file__))
    done = subprocess.run(
        [sys.executable, "-m", "mkdocs", "build", "--strict", "--site-dir", str(folder)],
        cwd=ROOT,
        env={**os.environ, "PYTHONPATH": sources, "NO_MKDOCS_2_WARNING": "1"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return folder


def test_nothing_is_loaded_from_elsewhere(site):
    pages = list(site.rglob("*.html"))
    assert len(pages) > 30
    assert not [page.name for page in pages if _LOADED.search(page.read_text())]
    for sheet in site.rglob("*.css"):
        assert not re.search(r"(?:@import|url\()\s*[\"']?(?:https?:)?//", sheet.read_text())


def test_every_config_group_and_its_files_are_described(site):
    overview = (site / "configuration" / "index.html").read_text()
    for group in sorted(path.name for path in CONF.iterdir() if path.is_dir()):
        if group != "hydra":
            assert f"<code>{group}</code>" in overview
    refiners = (site / "configuration" / "refinement.html").read_text()
    for name in (path.stem for path in (CONF / "refinement").glob("*.yaml")):
        assert f"refinement={name}" in refiners
    assert "refinement.cost.weight_depth" in refiners


def test_every_command_is_described(site):
    from hlp.cli import COMMANDS

    page = (site / "command-line.html").read_text()
    for name in COMMANDS:
        assert f"usage: hlp {name}" in page or f"hlp {name}:" in page


def test_shapes_of_arrays_are_printed_as_strings(site):
    text = re.sub(r"<[^>]+>", "", (site / "reference" / "records.html").read_text())
    assert re.search(r"probabilities: Float\[np\.ndarray, (&#34;|&quot;|\")n", text)
