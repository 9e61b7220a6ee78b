"""Ways in which a file can be damaged."""

import os
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path

WAYS: Mapping[str, Callable[[bytes], bytes]] = {
    "empty": lambda content: b"",
    "cut": lambda content: content[: len(content) // 2],
    "end lost": lambda content: content[:-10],
    "flipped": lambda content: flipped(content, len(content) // 2),
    "garbage": lambda content: os.urandom(len(content)),
}


def damage(paths: Iterable[Path], way: str) -> int:
    """Damage all files among the paths; their number."""
    files = [path for path in paths if path.is_file() and path.stat().st_size > 0]
    for path in files:
        path.write_bytes(WAYS[way](path.read_bytes()))
    return len(files)


def flipped(content: bytes, at: int) -> bytes:
    """With one bit of the byte `at` changed."""
    return content[:at] + bytes([content[at] ^ 1]) + content[at + 1 :]
