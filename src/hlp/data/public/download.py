"""Loading and unpacking a public data set into one folder, which appears when it is complete."""

import hashlib
import logging
import re
import shutil
from pathlib import Path

from filelock import FileLock, Timeout

from hlp.data.public.archives import require_room, unpack
from hlp.data.public.sets import Archive, PublicSet
from hlp.errors import DataError, HlpError, InputError, NetworkError
from hlp.files import write_json

SOURCES = "sources.json"
"""What a loaded folder was made from: addresses, sizes and checksums of the archives, licence."""
_SHA256 = re.compile(r"[0-9a-f]{64}")
_logger = logging.getLogger(__name__)


def download(public: PublicSet, folder: Path, images: str, mirror: str | None = None) -> Path:
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
    unpacked = partial / "unpacked"
    partial.mkdir(parents=True, exist_ok=True)
    lock = FileLock(folder.with_name(f".{folder.name}.lock"))
    try:
        with lock.acquire(timeout=0):
            sources = [fetch(archive, partial / archive.name) for archive in archives]
            shutil.rmtree(unpacked, ignore_errors=True)
            unpacked.mkdir()
            for archive in archives:
                count = unpack(partial / archive.name, unpacked, public.name)
                _logger.info("%s: %d files", archive.name, count)
            about = {"name": public.name, "licence": public.licence, "page": public.page}
            write_json(unpacked / SOURCES, about | {"archives": sources})
            unpacked.rename(folder)
            shutil.rmtree(partial)
    except Timeout as error:
        raise InputError(f"another process is loading {folder}: wait for it") from error
    Path(lock.lock_file).unlink(missing_ok=True)
    return folder


def fetch(archive: Archive, target: Path) -> dict[str, object]:
    """Load a file to `target`, unless it is there; its address, size and SHA-256.

    huggingface_hub loads it, from any server; it continues what an earlier call left, if the server
    still has the same version. The file is compared with what is known of it and with what the
    server states. Raises NetworkError and DiskFullError, which keep what was loaded, and DataError
    for another file than the known one.
    """
    path, stated = (target, None) if target.is_file() else _receive(archive, target)
    size, sha256 = path.stat().st_size, _digest(path, "sha256")
    verified = []
    for known in dict.fromkeys((archive.checksum, stated)):
        if known is not None:
            kind, _, digest = known.partition(":")
            found = sha256 if kind == "sha256" else _digest(path, kind)
            if found != digest:
                path.unlink()
                raise _wrong(archive, f"its {kind} is {found}, not {digest} (deleted: {path})")
            verified.append(f"{kind} {'known' if known == archive.checksum else 'of the server'}")
    path.rename(target)
    said = ", ".join(verified) or "size alone"
    _logger.info("%s: %.1f MB, verified: %s", archive.name, size / 1e6, said)
    return {"url": archive.url, "bytes": size, "sha256": sha256}


def _digest(path: Path, kind: str) -> str:
    with path.open("rb") as stream:
        return hashlib.file_digest(stream, kind).hexdigest()


def _receive(archive: Archive, target: Path) -> tuple[Path, str | None]:
    """Load a file beside `target`; the checksum that the server states of it, as Hugging Face's do.

    Raises NetworkError, DiskFullError, and DataError for another file than the known one.
    """
    import httpx2
    from huggingface_hub import get_hf_file_metadata
    from huggingface_hub.file_download import http_get

    part = target
    try:
        about = get_hf_file_metadata(archive.url, token=False)  # a mirror must not get the user's
        etag = about.etag or ""
        stated = _compared(archive, etag, about.size)
        # A part is continued only as the beginning of the same version.
        part = target.with_name(f"{target.name}.{re.sub(r'[^0-9a-zA-Z]', '', etag)[:64]}.part")
        have = part.stat().st_size if etag and part.is_file() else 0
        require_room(target.parent, (about.size or have) - have, f"the rest of {archive.name}")
        with part.open("ab" if have else "wb") as stream:
            http_get(
                about.location,
                stream,
                resume_size=have,
                expected_size=about.size or archive.size,
                displayed_filename=archive.name,
            )
    except HlpError:
        raise
    except (httpx2.HTTPError, OSError) as error:
        if not isinstance(error, httpx2.HTTPError) and error.errno is not None:
            raise  # of the disk
        have = part.stat().st_size if part.is_file() else 0
        kept = f"{have / 1e6:.1f} MB are kept in {part}" if have else "nothing is loaded yet"
        reason = str(error).partition("\n")[0] or type(error).__name__
        raise NetworkError(
            f"{archive.url} cannot be loaded ({reason}); {kept}: check the network, and call again "
            "to continue, or give another server with mirror=URL"
        ) from error
    return part, stated


def _compared(archive: Archive, etag: str, size: int | None) -> str | None:
    """The checksum that a server states, if any. Raises DataError for another than the known."""
    stated = f"sha256:{etag}" if _SHA256.fullmatch(etag) else None
    if stated and archive.checksum not in (None, stated):
        raise _wrong(archive, f"its checksum is {stated}, not {archive.checksum}")
    if size and archive.size not in (None, size):
        raise _wrong(archive, f"it has {size} bytes, not {archive.size}")
    return stated


def _wrong(archive: Archive, problem: str) -> DataError:
    return DataError(
        f"{archive.url} is not the file that it should be: {problem}. Call again, or give another "
        "server with mirror=URL"
    )
