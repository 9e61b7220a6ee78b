"""What a result was made from: code, libraries, machine, and the outputs that manifests name."""

import json
import platform
import subprocess

import pytest
import torch

import hlp
from hlp.errors import DataError, MissingFileError
from hlp.stages.manifest import code_digest, device_name, git_revision, library_builds, processor
from hlp.stages.store import StageStore
from hlp.stages.warm_start import WarmStartSettings, read_warm_start
from tiny_method import tiny_method

NAME = "0123456789abcdef"


def git(folder, *words):
    who = ("-c", "user.name=a", "-c", "user.email=a@b")
    return subprocess.check_output(["git", *who, *words], cwd=folder, text=True).strip()


@pytest.fixture
def package(tmp_path, monkeypatch):
    """A package in a checkout."""
    folder = tmp_path / "src" / "hlp"
    folder.mkdir(parents=True)
    (folder / "__init__.py").write_text("")
    git(tmp_path, "init", "-q")
    git(tmp_path, "add", ".")
    git(tmp_path, "commit", "-q", "-m", "first")
    monkeypatch.setattr(hlp, "__file__", str(folder / "__init__.py"))
    return folder


def test_revision_is_the_commit_and_says_what_was_changed_since(package, monkeypatch):
    commit, digest = git(package, "rev-parse", "HEAD"), code_digest()
    assert git_revision() == commit
    (package / "__init__.py").write_text("changed = True\n")
    assert git_revision() == f"{commit}+"
    assert code_digest() != digest
    installed = package.parents[1] / ".venv" / "hlp"  # inside another's checkout
    installed.mkdir(parents=True)
    (installed / "__init__.py").write_text("")
    monkeypatch.setattr(hlp, "__file__", str(installed / "__init__.py"))
    assert git_revision() is None
    monkeypatch.setattr(hlp, "__file__", str(package / "__init__.py"))
    monkeypatch.setenv("PATH", "")
    assert git_revision() is None


def test_this_machine_and_its_libraries_are_named():
    assert library_builds().keys() >= {"numpy", "torch", "onnxruntime"}
    found = processor()
    assert found["system"] == " ".join((platform.system(), platform.machine()))
    assert found["type"]
    if platform.machine() == "x86_64":
        assert "sse2" in found["features"].split()


@pytest.mark.parametrize("there", [True, False])
def test_a_device_is_named_by_what_computes(there, monkeypatch):
    monkeypatch.setattr(torch.cuda, "is_available", lambda: there)
    monkeypatch.setattr(torch.cuda, "get_device_name", lambda: "RTX 5090")
    monkeypatch.setattr(torch.backends.mps, "is_available", lambda: False)
    found = [device_name(device) for device in ("gpu", "auto", "cpu")]
    assert found == (["RTX 5090", "RTX 5090", "cpu"] if there else ["gpu", "cpu", "cpu"])


def start(folder, stages):
    """Read a warm start from a manifest that names these outputs."""
    (folder / "manifest.json").write_text(json.dumps({"config": {}, "stages": stages}))
    store = StageStore(folder / "work")
    start = WarmStartSettings(str(folder / "manifest.json"))
    read_warm_start(start, tiny_method(), {}, store)


@pytest.mark.parametrize("name", ["../../secret", "/etc", "", NAME.upper(), NAME + "0"])
def test_a_manifest_names_no_other_folder(tmp_path, name):
    with pytest.raises(DataError, match=r"manifest\.json: .* is not a fingerprint"):
        start(tmp_path, [{"stage": "classifier", "fingerprint": name}])


@pytest.mark.parametrize(
    "stages", [1, [1], [{}], "abc", [{"stage": "classifier", "fingerprint": 7}]]
)
def test_a_damaged_manifest_is_named(tmp_path, stages):
    with pytest.raises(DataError, match=r"manifest\.json, stages: "):
        start(tmp_path, stages)


def test_a_missing_and_a_damaged_classifier_are_named(tmp_path):
    stages = [{"stage": "classifier", "fingerprint": NAME}]
    with pytest.raises(MissingFileError, match="has no classifier"):
        start(tmp_path, stages)
    store = StageStore(tmp_path / "work")
    folder = store.get_or_make("classifier", NAME, lambda folder: (folder / "x").touch(), {})
    (folder / "x").write_bytes(b"more")
    with pytest.raises(DataError, match=f"{NAME}/x is missing or damaged"):
        start(tmp_path, stages)
