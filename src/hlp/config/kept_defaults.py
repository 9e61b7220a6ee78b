"""The settings' defaults, kept in the user's cache between processes.

A command that only composes a configuration, as `hlp run --cfg job`, reads them from there and
imports neither the settings' classes nor NumPy, which would take a third of its time. They are made
again when any Python file of the package has changed. A process that has imported the classes
before neither reads nor writes them: a file may have been edited since.
"""

import hashlib
import sys
from functools import cache
from pathlib import Path
from typing import Any

import hlp
from hlp.user_cache import KeptValues, writable_folder


@cache
def kept_defaults() -> dict[str, dict[str, Any]]:
    """Default values of settings by path, e.g. `refinement/base_pso`, as far as they are kept."""
    return _kept().read()


def keep_defaults(path: str, values: dict[str, Any]) -> None:
    """Keep the defaults of one more path."""
    kept_defaults()[path] = values
    _kept().write(kept_defaults())


@cache
def _kept() -> KeptValues:
    """One file for each place where the package is installed."""
    package = Path(hlp.__file__).parent
    place = hashlib.blake2b(str(package).encode(), digest_size=8).hexdigest()
    folder = None if _has_classes() else writable_folder("defaults")
    return KeptValues(folder, f"{place}.json", _digest(package))


def _has_classes() -> bool:
    return "hlp.config.settings" in sys.modules


def _digest(package: Path) -> str:
    """16 hex digits of the content of all Python files: dates and sizes miss some edits."""
    digest = hashlib.blake2b(digest_size=8)
    for path in sorted(package.rglob("*.py")):
        content = path.read_bytes()
        digest.update(f"{path.relative_to(package)}\0{len(content)}\0".encode() + content)
    return digest.hexdigest()
