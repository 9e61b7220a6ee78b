"""CONTRIBUTING's example of an alternative, installed from a package of its own, runs."""

import re
import sys
import tomllib
from pathlib import Path

import pytest

from bad_input import written
from forked_hlp import succeed
from hlp.errors import ConfigError
from hlp.models.encoder import ENCODERS
from run_files import read_json
from tiny_run import TINY, run_here

CONTRIBUTING = Path(__file__).parents[2] / "CONTRIBUTING.md"
BLOCK = re.compile(r'```\w+ title="([^"]+)"\n(.*?)```', re.DOTALL)


@pytest.fixture
def plug_in(tmp_path):
    """A folder with the example's files, and what pip would write beside them."""
    for name, content in BLOCK.findall(CONTRIBUTING.read_text()):
        written(tmp_path / name, content)
    project = tomllib.loads((tmp_path / "pyproject.toml").read_text())["project"]
    installed = tmp_path / "my_hlp-1.0.dist-info"
    installed.mkdir()
    (installed / "METADATA").write_text("Metadata-Version: 2.1\nName: my_hlp\nVersion: 1.0\n")
    lines = [
        f"[{group}]\n" + "\n".join(f"{name} = {module}" for name, module in entries.items())
        for group, entries in project["entry-points"].items()
    ]
    (installed / "entry_points.txt").write_text("\n".join(lines))
    return tmp_path


@pytest.mark.slow
@pytest.mark.thorough
def test_the_example_is_found_by_its_name_and_runs(plug_in):
    chosen = ("--config-dir", str(plug_in / "conf"), "encoder=cells", "encoder.cells=4")
    tiny = [setting for setting in TINY if not setting.startswith("encoder=")]
    succeed(plug_in, "run", *chosen, *tiny, "panels=0", "output=out")
    manifest = read_json(plug_in / "out" / "manifest.json")
    assert manifest["config"]["encoder"] == {"name": "cells", "cells": 4}
    assert read_json(plug_in / "out" / "summary.json")["targets"] > 0


@pytest.fixture
def installed(plug_in, monkeypatch):
    """The plug-in can be imported by this process, which forgets it afterwards."""
    monkeypatch.syspath_prepend(plug_in)
    monkeypatch.chdir(plug_in)
    yield plug_in
    ENCODERS._known.pop("cells", None)
    for name in [name for name in sys.modules if name.partition(".")[0] == "my_hlp"]:
        del sys.modules[name]


def test_every_value_is_shown_and_a_mistake_is_named(installed):
    """A folder on the search path will do as well as an option."""
    path = f"hydra.searchpath=[file://{installed / 'conf'}]"
    code, shown, _ = run_here("--cfg", "job", path, "encoder=cells")
    assert code == 0 and "encoder:\n  name: cells\n  cells: 8\n" in shown
    assert "  theta_deg: 10.0\n" in shown
    assert "base_" not in shown
    chosen = ("--config-dir", str(installed / "conf"), "encoder=cells", "encoder.cells=0")
    code, _, said = run_here(*chosen, "output=out")
    assert code == 1
    assert said.strip().endswith("encoder.cells is 0: it must be at least 1")


def test_without_its_entry_point_it_is_not_known(installed):
    (installed / "my_hlp-1.0.dist-info" / "entry_points.txt").unlink()
    with pytest.raises(ConfigError, match="is 'cells': choose one of cae, contrastive, pca"):
        ENCODERS.find("cells", "encoder")
