"""Defaults kept between processes, of a copy of the package whose files may be changed."""

import json
import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from omegaconf import OmegaConf

import hlp
from hlp.config import kept_defaults as module
from hlp.config.kept_defaults import keep_defaults, kept_defaults
from hlp.config.typed_defaults import TypedDefaults, group_kinds
from hlp.registry import Registry
from hlp.settings import defaults_of

ROOT = Path(hlp.__file__).parents[2]


@pytest.fixture
def empty_cache(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Iterator[Path]:
    """The user's cache as the first process finds it; it has not imported the classes yet."""
    monkeypatch.setattr(module, "_has_classes", lambda: False)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    forget()
    yield tmp_path / "hlp" / "defaults"
    forget()


def forget() -> None:
    """Let the file be read again, as by another process."""
    module._kept.cache_clear()
    kept_defaults.cache_clear()


def test_what_is_kept_is_what_the_classes_say(empty_cache: Path) -> None:
    expected = {}
    for group, kind in group_kinds().items():
        if isinstance(kind, Registry):
            for name, each in kind.alternatives().items():
                if each.__module__.startswith("hlp."):
                    expected[f"{group}/base_{name}"] = defaults_of(each, name)
        else:
            expected[f"{group}/base"] = defaults_of(kind)
    source = TypedDefaults("hlp", "hlp-defaults://")
    for path in expected:
        assert source.is_config(path)
    forget()
    assert kept_defaults().keys() == expected.keys()
    for path, values in expected.items():
        loaded = source.load_config(f"{path}.yaml").config
        assert loaded == OmegaConf.create(values), path


def test_the_defaults_of_a_plug_in_are_not_kept(empty_cache: Path) -> None:
    registry = group_kinds()["refinement"]
    assert isinstance(registry, Registry)
    known = registry.find("icp")
    theirs = type("TheirSettings", (known,), {"__module__": "their_package"})
    registry._known["theirs"] = theirs
    try:
        assert TypedDefaults("hlp", "hlp-defaults://").is_config("refinement/base_theirs")
    finally:
        del registry._known["theirs"]
    assert not any(empty_cache.glob("*.json"))


def test_a_process_that_has_the_classes_neither_reads_nor_keeps_others(
    empty_cache: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    keep_defaults("score/base", {"a": 1})
    monkeypatch.undo()
    monkeypatch.setenv("XDG_CACHE_HOME", str(empty_cache.parents[1]))
    forget()
    assert kept_defaults() == {}
    before = next(empty_cache.glob("*.json")).read_bytes()
    assert TypedDefaults("hlp", "hlp-defaults://").is_config("score/base")
    assert [path.read_bytes() for path in empty_cache.glob("*.json")] == [before]


def test_a_cache_that_cannot_be_written_costs_no_more_than_time(
    empty_cache: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "writable_folder", lambda name: None)
    keep_defaults("score/base", {"a": 1})
    forget()
    assert kept_defaults() == {}
    assert TypedDefaults("hlp", "hlp-defaults://").is_config("score/base")


def shown(package: Path, cache: Path) -> str:
    """The particles of `hlp run --cfg job`, by the package in that folder."""
    environment = {**os.environ, "PYTHONPATH": str(package.parent), "XDG_CACHE_HOME": str(cache)}
    done = subprocess.run(
        [sys.executable, "-m", "hlp", "run", "--cfg", "job", "-p", "refinement"],
        env=environment, capture_output=True, text=True, check=True,
    )  # fmt: skip
    return next(line for line in done.stdout.splitlines() if line.startswith("particles: "))


def test_an_edit_or_damage_makes_them_again(tmp_path: Path) -> None:
    package, cache = tmp_path / "src" / "hlp", tmp_path / "cache"
    shutil.copytree(ROOT / "src" / "hlp", package, ignore=shutil.ignore_patterns("__pycache__"))
    shutil.copytree(ROOT / "conf", tmp_path / "conf")
    first = shown(package, cache)
    (kept,) = (cache / "hlp" / "defaults").glob("*.json")
    content = json.loads(kept.read_text())
    content["values"]["refinement/base_pso"]["particles"] = 1
    kept.write_text(json.dumps(content))
    assert shown(package, cache) == "particles: 1"  # it is what is read
    kept.write_text(kept.read_text()[:-20])
    assert shown(package, cache) == first

    source = package / "refinement" / "pso.py"
    before, text = source.stat(), source.read_text()
    value = first.removeprefix("particles: ")
    assert text.count(f"= {value}\n") == 1
    source.write_text(text.replace(f"= {value}\n", f"= {int(value) + 1}\n"))
    os.utime(source, ns=(before.st_atime_ns, before.st_mtime_ns))
    assert source.stat().st_size == before.st_size
    assert shown(package, cache) == f"particles: {int(value) + 1}"
