"""Whether a run is using a store: a lock that runs share, and that cleaning takes alone."""

import sys
import weakref
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO

from hlp.errors import InputError

_NAME = ".in-use"


class StoreUse:
    """Says that a store is in use, from `begin` until the process ends or this object goes.

    The system frees the lock of a dead process. Without effect on Windows, and in a store that this
    process may only read.
    """

    def __init__(self, root: Path) -> None:
        self._root = root
        self._held: IO[bytes] | None = None

    def begin(self) -> None:
        """Hold the lock, together with other runs; waits while the store is being cleaned."""
        if self._held is not None or sys.platform == "win32":
            return
        import fcntl

        try:
            self._held = (self._root / _NAME).open("ab")
            weakref.finalize(self, self._held.close)
            fcntl.flock(self._held, fcntl.LOCK_SH)
        except OSError:  # no folder yet, a read-only one, or a file system without locks
            return


@contextmanager
def unused(root: Path) -> Iterator[None]:
    """Keep runs from beginning to use a store. Raises InputError while one uses it."""
    if sys.platform == "win32":
        yield
        return
    import fcntl

    with (root / _NAME).open("ab") as stream:
        try:
            fcntl.flock(stream, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            raise InputError(f"a run is using {root}: wait until it has ended") from error
        yield
