import platform
import subprocess
from importlib.metadata import FileHash, PackagePath
from pathlib import Path

import pytest

import hlp
from hlp.stages import manifest as provenance
from hlp.stages.manifest import code_digest, git_revision, library_builds, processor


def git(folder: Path, *words: str) -> str:
    who = ("-c", "user.name=a", "-c", "user.email=a@b")
    done = subprocess.run(
        ["git", *who, *words], cwd=folder, check=True, capture_output=True, text=True
    )
    return done.stdout.strip()


@pytest.fixture
def package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A package in a checkout."""
    folder = tmp_path / "src" / "hlp"
    folder.mkdir(parents=True)
    (folder / "__init__.py").write_text("")
    git(tmp_path, "init", "-q")
    git(tmp_path, "add", ".")
    git(tmp_path, "commit", "-q", "-m", "first")
    monkeypatch.setattr(hlp, "__file__", str(folder / "__init__.py"))
    return folder


def test_revision_is_the_commit_and_says_what_was_changed_since(package: Path) -> None:
    commit = git(package, "rev-parse", "HEAD")
    assert git_revision() == commit
    digest = code_digest()
    (package / "__init__.py").write_text("changed = True\n")
    assert git_revision() == f"{commit}+"
    assert code_digest() != digest


def test_a_package_installed_inside_anothers_checkout_has_no_revision(
    package: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    installed = package.parents[1] / ".venv" / "hlp"
    installed.mkdir(parents=True)
    (installed / "__init__.py").write_text("")
    monkeypatch.setattr(hlp, "__file__", str(installed / "__init__.py"))
    assert git_revision() is None


def test_without_git_there_is_no_revision(package: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", "")
    assert git_revision() is None


class Installed:
    """A distribution whose installer recorded these files with their hashes."""

    def __init__(self, **hashes: str | None) -> None:
        self.files = []
        for name, value in hashes.items():
            path = PackagePath(f"library/{name.replace('_', '.')}")
            path.hash = None if value is None else FileHash(f"sha256={value}")
            self.files.append(path)


def test_a_build_is_known_by_its_compiled_files(monkeypatch: pytest.MonkeyPatch) -> None:
    def builds(**hashes: str | None) -> dict[str, str]:
        monkeypatch.setattr(provenance, "distribution", lambda name: Installed(**hashes))
        return library_builds()

    first = builds(core_so="a", blas_so_3="b", init_py="c")
    assert first.keys() == {*provenance.LIBRARIES, "llvmlite"}
    assert builds(core_so="a", blas_so_3="b", init_py="d", core_pyc=None) == first
    assert builds(blas_so_3="b", core_so="a", init_py="c") == first
    other = builds(core_so="a", blas_so_3="x", init_py="c")
    assert all(other[name] != first[name] for name in first)
    assert builds(init_py="c", core_so=None) == {}


def test_this_machine_and_its_libraries_are_named() -> None:
    assert library_builds().keys() >= {"numpy", "torch", "onnxruntime"}
    found = processor()
    assert found["system"] == " ".join((platform.system(), platform.machine()))
    assert found["type"]
    if platform.machine() == "x86_64":
        assert "sse2" in found["features"].split()
