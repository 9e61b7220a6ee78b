"""What may follow what was typed of a configuration: groups, their alternatives, and keys.

Composing a configuration takes a second, too long for a keystroke. Its keys are composed once for
each choice of alternatives, and kept in the user's cache until configuration or code change.
"""

import hashlib
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path

import hlp
from hlp.user_cache import KeptValues, writable_folder

_KEPT = 50  # choices of alternatives


def configuration_words(
    words: Sequence[str], folder: Path, compose: Callable[[Sequence[str]], Sequence[str]]
) -> list[str]:
    """The words that may stand for the last of `words`, all after it begins as they do.

    `folder` is that of the configuration; `compose` gives all keys for some choices of
    alternatives, e.g. `task=search`. Dots and `=` are kept at the end of what goes on.
    """
    typed, groups = words[-1], _groups(folder)
    name, sign, _ = typed.partition("=")
    if sign:
        return _fitting((f"{name}={each}" for each in _alternatives(folder, name)), typed)
    chosen = [each for each in words[:-1] if each.partition("=")[0] in groups and "," not in each]
    keys = _kept(chosen, folder, compose)
    depth = typed.count(".") + 1
    parts = (key.split(".") for key in keys)
    nodes = {
        ".".join(each[:depth]) + ("." if len(each) > depth else "=")
        for each in parts
        if len(each) >= depth
    }
    nodes |= {f"{group}=" for group in groups if _alternatives(folder, group)}
    return _fitting(nodes, typed)


def _fitting(candidates: Iterable[str], typed: str) -> list[str]:
    return sorted(each for each in candidates if each.startswith(typed))


def _groups(folder: Path) -> set[str]:
    """The groups of the configuration, those within others too: `refinement/cost`."""
    return {
        path.relative_to(folder).as_posix()
        for path in folder.rglob("*")
        if path.is_dir() and not path.name.startswith(("_", "."))
    }


def _alternatives(folder: Path, group: str) -> list[str]:
    return [path.stem for path in (folder / group).glob("*.yaml")]


def _kept(
    chosen: Sequence[str], folder: Path, compose: Callable[[Sequence[str]], Sequence[str]]
) -> list[str]:
    """The keys for these choices, from the cache if they are in it."""
    kept = KeptValues(writable_folder("completion"), "keys.json", _state(folder))
    known, choice = kept.read(), " ".join(chosen)
    if choice in known:
        return list(known[choice])
    keys = list(compose(chosen))
    kept.write(dict(list(known.items())[-_KEPT + 1 :]) | {choice: keys})
    return keys


def _state(folder: Path) -> str:
    """A digest of what the keys are made from: files of the configuration, and the code."""
    package = Path(hlp.__file__).parent
    digest = hashlib.blake2b(hlp.__version__.encode(), digest_size=16)
    for path in sorted([*folder.rglob("*.yaml"), *package.rglob("*.py")]):
        about = path.stat()
        digest.update(f"{path} {about.st_size} {about.st_mtime_ns}\n".encode())
    return digest.hexdigest()
