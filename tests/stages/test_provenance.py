import subprocess
from pathlib import Path

import pytest

import hlp
from hlp.stages.provenance import code_digest, git_revision


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
