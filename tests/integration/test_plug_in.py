"""CONTRIBUTING's example of an alternative, installed from a package of its own, runs."""

import re
import tomllib
from pathlib import Path

import pytest

from forked_hlp import run_hlp
from run_files import read_json
from tiny_run import TINY

CONTRIBUTING = Path(__file__).parents[2] / "CONTRIBUTING.md"
BLOCK = re.compile(r'```\w+ title="([^"]+)"\n(.*?)```', re.DOTALL)


@pytest.fixture
def plug_in(tmp_path):
    """A folder with the example's files, and what pip would write beside them."""
    for name, content in BLOCK.findall(CONTRIBUTING.read_text()):
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(content)
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
    done = run_hlp(plug_in, "run", *chosen, *tiny, "panels=0", "output=out")
    assert done.returncode == 0, done.stderr
    manifest = read_json(plug_in / "out" / "manifest.json")
    assert manifest["config"]["encoder"] == {"name": "cells", "cells": 4}
    assert read_json(plug_in / "out" / "summary.json")["targets"] > 0


def test_every_value_is_shown_and_a_mistake_is_named(plug_in):
    """A folder on the search path will do as well as an option."""
    path = f"hydra.searchpath=[file://{plug_in / 'conf'}]"
    done = run_hlp(plug_in, "run", "--cfg", "job", path, "encoder=cells")
    assert done.returncode == 0, done.stderr
    assert "encoder:\n  name: cells\n  cells: 8\n" in done.stdout
    assert "  theta_deg: 10.0\n" in done.stdout
    assert "base_" not in done.stdout
    chosen = ("--config-dir", str(plug_in / "conf"), "encoder=cells", "encoder.cells=0")
    done = run_hlp(plug_in, "run", *chosen, "output=out")
    assert done.returncode == 1
    assert done.stderr.strip().endswith("encoder.cells is 0: it must be at least 1")
    (plug_in / "my_hlp-1.0.dist-info" / "entry_points.txt").unlink()
    done = run_hlp(plug_in, "run", "encoder.name=cells")
    assert done.returncode == 1
    assert "encoder.name is 'cells': choose one of cae, contrastive, pca" in done.stderr
