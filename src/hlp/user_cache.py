"""What HLP keeps in the user's cache, so that later processes need not make it again."""

import json
import os
import sys
import tempfile
from contextlib import suppress
from pathlib import Path
from typing import Any

import platformdirs


def writable_folder(name: str) -> Path | None:
    """A folder of that name that this user can write and nobody else; None if there is none.

    It is in the user's cache folder, or, where that cannot be written, as without a home, a folder
    for temporary files. The package's own folder is never written.
    """
    # Without a home this is a relative path, which begins with "~".
    users = platformdirs.user_cache_path("hlp", appauthor=False) / name
    temporary = Path(tempfile.gettempdir(), f"hlp-{name}-{_user()}")
    places = [users, temporary] if users.is_absolute() else [temporary]
    return next((place for place in places if _is_ours(place)), None)


def _is_ours(folder: Path) -> bool:
    """Whether a folder can be written, and by nobody else: what lies there is used unseen."""
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        status = folder.stat()
        tempfile.TemporaryFile(dir=folder).close()
    except OSError:
        return False
    return sys.platform == "win32" or (status.st_uid == _user() and not status.st_mode & 0o022)


def _user() -> int:
    return 0 if sys.platform == "win32" else os.getuid()  # there, temporary files are a user's own


class KeptValues:
    """A file of values by name that hold as long as a `state`, a digest of their sources, does.

    `folder` is None where nothing can be kept. Values are those of JSON.
    """

    def __init__(self, folder: Path | None, file: str, state: str) -> None:
        self._file = None if folder is None else folder / file
        self._state = state

    def read(self) -> dict[str, Any]:
        """All values; none if the file is missing, damaged or of another state."""
        if self._file is not None:
            with suppress(OSError, ValueError, TypeError, KeyError, RecursionError):
                content = json.loads(self._file.read_text(encoding="utf-8"))
                if content["state"] == self._state and isinstance(content["values"], dict):
                    return dict(content["values"])
        return {}

    def write(self, values: dict[str, Any]) -> None:
        """Replace all values. Where that fails, as on a full disk, they are made again each time.

        This is not done by `hlp.files`, which takes longer to import than everything here.
        """
        if self._file is None:
            return
        with suppress(OSError):
            partial = self._file.with_name(f".{self._file.name}.{os.getpid()}")
            partial.write_text(json.dumps({"state": self._state, "values": values}))
            partial.replace(self._file)
