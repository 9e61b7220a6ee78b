"""Loading and unpacking a public data set into one folder, which appears when it is complete."""

import logging
import shutil
from collections.abc import Sequence
from pathlib import Path

from filelock import FileLock, Timeout

from hlp.data.public.archives import unpack
from hlp.data.public.http_file import WAITS, LoadedFile, fetch
from hlp.data.public.sets import Archive, PublicSet
from hlp.errors import InputError
from hlp.files import write_json

SOURCES = "sources.json"
"""What a loaded folder was made from: addresses, sizes and checksums of the archives, licence."""
_logger = logging.getLogger(__name__)


def download(
    public: PublicSet,
    folder: Path,
    images: str,
    mirror: str | None = None,
    waits: Sequence[float] = WAITS,
) -> Path:
    """Load a data set into a new folder.

    Archives and what is unpacked of them lie in a folder beside it, `.NAME.partial`, until all is
    there; a call after an interruption continues there. Raises InputError if `folder` is there
    already, and what `fetch` and `unpack` raise.
    """
    archives = public.files(images, mirror)
    folder = folder.absolute()
    if folder.exists():
        raise InputError(f"{folder} is there already: use it, or name another folder with output=")
    partial = folder.with_name(f".{folder.name}.partial")
    partial.mkdir(parents=True, exist_ok=True)
    lock = FileLock(folder.with_name(f".{folder.name}.lock"))
    try:
        with lock.acquire(timeout=0):
            loaded = []
            for archive in archives:
                file = fetch(archive, partial / archive.name, waits)
                size = file.path.stat().st_size / 1e6
                _logger.info("%s: %.1f MB, verified: %s", archive.name, size, file.verified)
                loaded.append(file)
            _unpack_all(public, loaded, partial / "unpacked")
            write_json(partial / "unpacked" / SOURCES, _sources(public, archives, loaded))
            (partial / "unpacked").rename(folder)
            shutil.rmtree(partial)
    except Timeout as error:
        raise InputError(f"another process is loading {folder}: wait for it") from error
    Path(lock.lock_file).unlink(missing_ok=True)
    return folder


def _unpack_all(public: PublicSet, loaded: Sequence[LoadedFile], unpacked: Path) -> None:
    shutil.rmtree(unpacked, ignore_errors=True)
    unpacked.mkdir()
    for file in loaded:
        _logger.info("%s: %d files", file.path.name, unpack(file.path, unpacked, public.name))


def _sources(
    public: PublicSet, archives: Sequence[Archive], loaded: Sequence[LoadedFile]
) -> dict[str, object]:
    return {
        "name": public.name,
        "licence": public.licence,
        "page": public.page,
        "archives": [
            {"url": archive.url, "bytes": file.path.stat().st_size, "sha256": file.sha256}
            for archive, file in zip(archives, loaded, strict=True)
        ],
    }
