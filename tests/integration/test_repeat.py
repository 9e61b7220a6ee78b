"""A run repeated from its manifest."""

import json
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

from tiny_run import TinyRun

pytestmark = [pytest.mark.slow, pytest.mark.thorough]

Call = Callable[..., tuple[int, str, str]]


@pytest.fixture
def manifest(tiny_run: TinyRun, tmp_path: Path) -> Path:
    """The tiny run's manifest, in another place than the run."""
    return Path(shutil.copy(tiny_run.output / "manifest.json", tmp_path / "kept.json"))


def poses(path: Path) -> list[list[str]]:
    return [line.split(",")[:-1] for line in path.read_text().splitlines()]


def test_same_manifest_same_poses(tiny_run: TinyRun, call: Call, manifest: Path) -> None:
    """Refined anew, with one thread; what came before is on disk."""
    for folder in (tiny_run.folder / "work" / "poses").iterdir():
        if folder.is_dir():
            shutil.rmtree(folder)
    code, said, _ = call(f"manifest={manifest}", "output=repeated", "machine.threads=1")
    assert code == 0
    assert f"Repeated  the same poses as in {manifest}" in said
    assert "made   poses" in said
    again = tiny_run.folder / "repeated"
    assert poses(again / "poses.csv") == poses(tiny_run.output / "poses.csv")
    before, after = (json.loads(path.read_text()) for path in (manifest, again / "manifest.json"))
    assert after["poses"] == before["poses"]
    assert after["config"]["machine"].pop("threads") == 1
    assert before["config"]["machine"].pop("threads") == 2
    del before["config"]["output"], after["config"]["output"]
    assert after["config"] == before["config"]


def test_other_poses_and_other_code_are_said(tiny_run: TinyRun, call: Call, manifest: Path) -> None:
    changed = json.loads(manifest.read_text())
    changed |= {"code": "0" * 16, "poses": "0" * 16}
    changed["versions"]["numpy"] = "1.0"
    changed["processor"]["type"] = "abacus"
    changed["builds"]["torch"] = "0" * 16
    manifest.write_text(json.dumps(changed))
    code, said, _ = call(f"manifest={manifest}", "output=other")
    assert code == 0
    assert f"HLP's code is not that of {manifest}" in said
    assert f"and 1.0 in {manifest}" in said
    assert f"processor: type differ from {manifest}" in said
    assert f"builds: torch differ from {manifest}" in said
    assert f"NOT the same poses as in {manifest}" in said


def test_what_cannot_be_repeated_stops_before_any_stage(call: Call, manifest: Path) -> None:
    code, said, error = call(f"manifest={manifest}", "refinement=icp")
    assert (code, said) == (1, "")
    assert "refinement=icp: " in error
    changed = json.loads(manifest.read_text())
    changed["data"]["frames"] = "other"
    manifest.write_text(json.dumps(changed))
    code, said, error = call(f"manifest={manifest}", "output=never")
    assert (code, said) == (1, "")
    assert f"not the data of {manifest}: frames differ" in error
    manifest.write_text("{}")
    assert "no manifest of a run" in call(f"manifest={manifest}")[2]
    assert "there is no file " in call(f"manifest={manifest.parent / 'absent.json'}")[2]
