"""Loading and unpacking a public data set into one folder, which appears when it is complete.

Archives were made by somebody else: nothing in them leads out of the folder, or fills a disk.
Members must be plain files and folders below the archive's root: no absolute paths, no `..`, no
links, no devices. What they take unpacked is stated in the archive and limited before anything is
written; Python's readers take no more of a member than is stated.
"""

import hashlib
import logging
import re
import shutil
import socket
import stat
import tarfile
import zipfile
import zlib
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import partial
from ipaddress import ip_address
from pathlib import Path, PurePosixPath
from typing import IO, Any

from hlp.data.public_sets import Archive, PublicSet
from hlp.errors import DataError, DiskFullError, InputError, NetworkError, is_expected
from hlp.files import write_json
from hlp.folders import locked

SOURCES = "sources.json"
"""What a loaded folder was made from: addresses, sizes and checksums of the archives, licence."""
_SHA256 = re.compile(r"[0-9a-f]{64}")
_MOST_RATIO = 20.0  # unpacked bytes per packed one; images and binary meshes have about 1 to 4
_FREE_OF_RATIO = 50_000_000  # bytes: text may be packed better
_RESERVE = 50e6  # bytes that stay free
_ENCRYPTED = 0x1
_BROKEN = (
    zipfile.BadZipFile, tarfile.TarError, zlib.error, EOFError, NotImplementedError,
    UnicodeDecodeError, MemoryError,  # of a size that no memory has
    FileExistsError, NotADirectoryError, IsADirectoryError,  # of a file that is a folder, too
)  # fmt: skip
_logger = logging.getLogger(__name__)


def download(public: PublicSet, folder: Path, images: str, mirror: str | None = None) -> Path:
    """Load a data set into a new folder.

    Archives and what is unpacked of them lie in a folder beside it, `.NAME.partial`, until all is
    there; a call after an interruption continues there. Before anything is loaded, the server is
    asked for all archives: their sizes are said, and the disk must have room. Raises InputError if
    `folder` is there already, and what `fetch` and `unpack` raise.
    """
    archives = public.files(images, mirror)
    folder = folder.absolute()
    if folder.exists():
        raise InputError(f"{folder} exists already: use it, or name another folder with output=")
    partial = folder.with_name(f".{folder.name}.partial")
    unpacked = partial / "unpacked"
    partial.mkdir(parents=True, exist_ok=True)
    lock = folder.with_name(f".{folder.name}.lock")
    with locked(lock, f"another process is loading {folder}: wait for it"):
        try:
            shutil.rmtree(unpacked, ignore_errors=True)
            _require_room_for(archives, partial)
            sources = [fetch(archive, partial / archive.name) for archive in archives]
            unpacked.mkdir()
            for archive in archives:
                count = unpack(partial / archive.name, unpacked, public.name)
                _logger.info("%s: %d files", archive.name, count)
            about = {"name": public.name, "licence": public.licence, "page": public.page}
            write_json(unpacked / SOURCES, about | {"archives": sources})
            unpacked.rename(folder)
            shutil.rmtree(partial)
        finally:
            for remove in (partial.rmdir, lock.unlink):  # if nothing of it was loaded
                with suppress(OSError):
                    remove()
    return folder


def _require_room_for(archives: Sequence[Archive], partial: Path) -> None:
    """Say how large the archives are, and what they need while they are unpacked."""
    needed = 0
    for archive in archives:
        there = partial / archive.name
        size = there.stat().st_size if there.is_file() else _ask(archive, there).size
        said = "size not stated" if size is None else f"{size / 1e6:,.1f} MB"
        _logger.info("source    %s (%s)", archive.url, said)
        needed += 2 * (size or 0)  # images take at least as much unpacked
    _logger.info("disk      %.1f GB until it is unpacked, then about half of that", needed / 1e9)
    have = sum(path.stat().st_size for path in partial.iterdir())
    require_room(partial, needed - have, "the data set, packed and unpacked,")


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
                raise DataError(
                    f"{archive.url} is not the file that it should be: its {kind} is {found}, not "
                    f"{digest[:12]}…. Call again, or give another server with mirror=URL"
                )
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

    Raises NetworkError and DiskFullError.
    """
    from huggingface_hub.file_download import http_get

    about = _ask(archive, target)
    # Another server's ETag may look like a checksum, and be none: only a hub names a commit.
    hub = about.commit_hash and _SHA256.fullmatch(about.etag or "")
    stated = f"sha256:{about.etag}" if hub else None
    # A part is continued only as the beginning of the same version.
    version = re.sub(r"[^0-9a-zA-Z]", "", about.etag or archive.checksum or "")[:64]
    part = target.with_name(f"{target.name}.{version}.part")
    have = part.stat().st_size if version and part.is_file() else 0
    require_room(target.parent, (about.size or have) - have, f"the rest of {archive.name}")
    with _explained(archive, part), part.open("ab" if have else "wb") as stream:
        plain = {"Accept-Encoding": "identity"}
        load = partial(http_get, about.location, stream, resume_size=have, headers=plain)
        load(expected_size=about.size, displayed_filename=archive.name)
    return part, stated


def _ask(archive: Archive, target: Path) -> Any:
    """What the server states of a file: size, ETag, commit, location. Raises NetworkError."""
    from huggingface_hub import get_hf_file_metadata, set_client_factory

    set_client_factory(partial(_client, archive.url))
    kept = next(target.parent.glob(f"{target.name}.*.part"), target)
    with _explained(archive, kept):
        return get_hf_file_metadata(archive.url, token=False)  # a mirror must not get the user's


@contextmanager
def _explained(archive: Archive, part: Path) -> Iterator[None]:
    """Raise NetworkError for what goes wrong in the network: what is kept, and what to do."""
    import httpx2
    from huggingface_hub.errors import HfHubHTTPError

    try:
        yield
    except (httpx2.HTTPError, OSError) as error:
        if is_expected(error):
            raise  # of the disk
        if isinstance(error, HfHubHTTPError) and error.response.status_code == 416:
            part.unlink()  # it does not end before the file
        have = part.stat().st_size if part.is_file() else 0
        kept = f"{have / 1e6:.1f} MB are kept in {part}" if have else "nothing is loaded yet"
        reason = str(error).partition("\n")[0] or type(error).__name__
        raise NetworkError(
            f"{archive.url} cannot be loaded ({reason}); {kept}: check the network, and call again "
            "to continue, or give another server with mirror=URL"
        ) from error


def _client(url: str) -> Any:
    """A client for a file; no redirect leads it from the internet into the user's own network."""
    import httpx2

    def check(request: httpx2.Request) -> None:
        if _is_near(request.url.host) and not _is_near(httpx2.URL(url).host):
            raise DataError(f"{url} leads to {request.url.host}, which is not in the internet")

    return httpx2.Client(event_hooks={"request": [check]}, follow_redirects=True, timeout=None)


def _is_near(host: str) -> bool:
    """Whether a name leads to an address of this machine or network, as far as it is known here."""
    try:
        found = socket.getaddrinfo(host, None)
    except OSError:  # a proxy may know it
        return False
    return not all(ip_address(str(place[4][0]).partition("%")[0]).is_global for place in found)


@dataclass(frozen=True)
class Member:
    """What an archive states of a file or folder in it, and how it is opened."""

    name: str
    size: int
    is_folder: bool
    is_plain: bool
    open: Callable[[], IO[bytes]]


def unpack(archive: Path, folder: Path, root: str) -> int:
    """Unpack a zip or tar file into a folder; the number of files.

    A folder called `root` that stands around members is left away. Raises DataError naming the
    archive and the member for anything but plain files below the archive's root, and for a damaged
    archive; DiskFullError if the disk has too little room.
    """
    try:
        with _opened(archive) as members:
            files = _checked(archive, members)
            total = sum(member.size for member in files.values())
            packed = archive.stat().st_size
            if total > _MOST_RATIO * packed + _FREE_OF_RATIO:
                said = f"{archive} takes {packed} bytes and states {total} unpacked"
                raise DataError(f"{said}: no data set does that, it is not unpacked")
            require_room(folder, total, f"{archive.name} unpacked")
            for path, member in files.items():
                inner = path.parts[1:] if path.parts[0] == root else path.parts
                target = folder.joinpath(*(inner or path.parts))
                target.parent.mkdir(parents=True, exist_ok=True)
                with member.open() as source, target.open("wb") as stream:
                    shutil.copyfileobj(source, stream)
            return len(files)
    except (*_BROKEN, OSError) as error:  # of the disk, or of a place that no archive has
        if is_expected(error) and not isinstance(error, _BROKEN):
            raise
        problem = str(error) or type(error).__name__
        raise DataError(f"{archive} is damaged ({problem}): delete it and call again") from error


def require_room(folder: Path, needed: float, what: str) -> None:
    """Raise DiskFullError unless a folder's disk has room for so many bytes."""
    free = shutil.disk_usage(folder).free
    if needed + _RESERVE > free:
        raise DiskFullError(
            f"{folder} has {free / 1e9:.1f} GB free, {what} takes {needed / 1e9:.1f}: free some, "
            "or choose another disk with output=FOLDER"
        )


@contextmanager
def _opened(archive: Path) -> Iterator[Iterator[Member]]:
    """The members one by one: of a tar file, they are known only as it is read."""
    if zipfile.is_zipfile(archive):
        with zipfile.ZipFile(archive) as packed:
            yield (
                Member(
                    info.filename, info.file_size, info.filename.endswith("/"), _is_plain(info),
                    partial(packed.open, info),
                )
                for info in packed.infolist()
            )  # fmt: skip
    else:
        with tarfile.open(archive) as tape:
            yield (
                Member(
                    info.name, info.size, info.isdir(), info.isreg() or info.isdir(),
                    partial(tape.extractfile, info),  # type: ignore[arg-type]
                )
                for info in tape
            )  # fmt: skip


def _is_plain(info: zipfile.ZipInfo) -> bool:
    kind = stat.S_IFMT(info.external_attr >> 16)
    return not info.flag_bits & _ENCRYPTED and kind in (0, stat.S_IFREG, stat.S_IFDIR)


def _checked(archive: Path, members: Iterator[Member]) -> dict[PurePosixPath, Member]:
    """The files by their paths below the archive's root. Raises DataError for anything else."""
    files: dict[PurePosixPath, Member] = {}
    for member in members:
        path = PurePosixPath(member.name)
        problem = None if member.is_plain else "is encrypted, a link or a device"
        if path.is_absolute() or ".." in path.parts or re.search(r"[\\:]", member.name):
            problem = "leads out of the folder, or may on some system"
        if problem is not None:
            raise DataError(f"{archive}: its member {member.name!r} {problem}: it is not unpacked")
        if not member.is_folder and path.parts:
            files[path] = member
    return files
