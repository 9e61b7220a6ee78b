"""Errors that HLP expects: something outside its code is wrong, and the message says what to do.

Only these are shown as one line on the command line. Any other exception is a bug and shows its
traceback. Each class is also a subclass of a built-in error, so `except ValueError` works too.
"""

import errno
import re

# The system is the cause: a full or failing disk, missing rights, a wrong path.
_MACHINES = {
    errno.ENOSPC, errno.EDQUOT, errno.EACCES, errno.EPERM, errno.EROFS, errno.EMFILE, errno.ENFILE,
    errno.ENAMETOOLONG, errno.ENOTDIR, errno.EIO, errno.EFBIG, errno.EEXIST, errno.EISDIR,
    errno.ELOOP, errno.ENOTEMPTY, errno.ESTALE,
}  # fmt: skip
_CONTROLS = re.compile(r"[\x00-\x09\x0b-\x1f\x7f-\x9f]")
_LONGEST = 300  # characters of a message: a file may hold, and name, anything


class HlpError(Exception):
    """Something outside HLP's code is wrong; the message names it and says what to do."""

    def __str__(self) -> str:
        return shortened(super().__str__())


def without_controls(text: str) -> str:
    """A text, which may be out of anybody's file, without what a terminal would obey."""
    return _CONTROLS.sub("\ufffd", text)


def shortened(text: str) -> str:
    """The beginning and the end of a message that is too long for people."""
    text, kept = without_controls(text), _LONGEST // 2 - 1
    return text if len(text) <= _LONGEST else f"{text[:kept]}…{text[-kept:]}"


class InputError(HlpError, ValueError):
    """An argument is wrong: an image, a camera matrix, a mesh, a name."""


class ConfigError(HlpError, ValueError):
    """The configuration is wrong; the message names the key."""


class DataError(HlpError, ValueError):
    """The content of a file or folder is wrong; the message names it."""


class DamagedError(DataError):
    """A file is not as HLP wrote it; the message names it."""


class MissingFileError(HlpError, FileNotFoundError):
    """A file or folder is missing; the message names it and, if a key set it, the key."""


class NetworkError(HlpError, ConnectionError):
    """A server cannot be reached or breaks off; the message says what is kept for the next call."""


class WorkerError(HlpError, RuntimeError):
    """A process that worked for this one was killed."""


class DiskFullError(HlpError, OSError):
    """There is too little room on a disk; the message names the folder and what it needs."""


class MissingDependencyError(HlpError, ImportError):
    """An optional package is missing; the message says what to install."""


def is_expected(error: BaseException) -> bool:
    """Whether an error is HLP's own or one of the system, and so not a bug."""
    of_system = isinstance(error, OSError) and error.errno in _MACHINES
    return of_system or isinstance(error, HlpError)
