"""How a command ends when it fails or is stopped: one line, and the exit code of shells."""

import logging
import os
import select
import signal
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from importlib.util import find_spec
from types import FrameType
from typing import NoReturn

from hlp.errors import MissingDependencyError, is_expected, shortened

INTERRUPTED, READER_GONE, TERMINATED = 130, 141, 143
EVERYTHING = (
    "To install everything: pip install torch==2.13.0, then pip install . in HLP's folder"
    " (requirements-detect.txt is enough for predict, live and doctor)"
)
_CONFIGURING = {"hydra", "omegaconf", "yaml"}
"""Libraries whose errors are about what was configured."""


class TerminatedError(KeyboardInterrupt):
    """The process was asked to end by SIGTERM; libraries treat it as they treat Ctrl-C."""


@contextmanager
def stops_in_one_line(continues: bool = True) -> Iterator[None]:
    """In the block, SIGTERM ends the process as Ctrl-C does: what is open is closed first.

    The process prints one line and exits with 130 (SIGINT) or 143 (SIGTERM); the line says so if
    the same command `continues` from there. A second SIGTERM changes nothing; SIGKILL always works,
    and what it leaves behind is put in order by the next run. The process exits with 141 and
    silently where nobody reads standard output any more, as in `hlp runs | head`.
    """
    before = signal.signal(signal.SIGTERM, _terminate)
    try:
        yield
        sys.stdout.flush()
    except BrokenPipeError:
        if not _reader_has_gone():
            raise
        os.dup2(os.open(os.devnull, os.O_WRONLY), 1)  # for what is still to be written
        sys.exit(READER_GONE)
    except KeyboardInterrupt as error:
        terminated = isinstance(error, TerminatedError)
        what = "terminated" if terminated else "interrupted"
        again = "; the same command continues from here" if continues else ""
        print(f"hlp: {what}{again}", file=sys.stderr)
        sys.exit(TERMINATED if terminated else INTERRUPTED)
    finally:
        signal.signal(signal.SIGTERM, before)


@contextmanager
def fails_in_one_line() -> Iterator[None]:
    """End the process with 1 after an expected error; any other is a bug and is raised.

    Expected are HLP's errors, the configuration's, and the system's, such as a full disk. Where
    only what finds objects is installed (requirements-detect.txt), so is a missing library.
    """
    try:
        yield
    except ModuleNotFoundError as error:
        if find_spec("torch") or error.name is None or error.name.partition(".")[0] == "hlp":
            raise
        fail(MissingDependencyError(f"{error.name} is not installed. {EVERYTHING}"))
    except Exception as error:
        if not is_foreseen(error):
            raise
        fail(error)


@contextmanager
def messages_on(stream: str) -> Iterator[None]:
    """In the block, HLP's messages appear on `stdout` or `stderr`; nothing is done if empty."""
    if not stream:
        yield
        return
    logger, handler = logging.getLogger("hlp"), logging.StreamHandler(getattr(sys, stream))
    seen = set[str]()  # one command may look into a folder several times: each warning once
    handler.addFilter(lambda record: not _is_repeated(record, seen))
    handler.setFormatter(logging.Formatter("%(message)s"))
    before = logger.level
    logger.addHandler(handler)
    logger.setLevel(logging.INFO)
    try:
        yield
    finally:
        logger.removeHandler(handler)
        logger.setLevel(before)


def _is_repeated(record: logging.LogRecord, seen: set[str]) -> bool:
    said = record.getMessage() if record.levelno >= logging.WARNING else ""
    repeated = said in seen
    seen.update({said} - {""})
    return repeated


def fail(error: BaseException) -> NoReturn:
    """Print the error's message and exit with 1; with HLP_TRACEBACK set, raise the error."""
    if os.environ.get("HLP_TRACEBACK", "0") not in {"", "0"}:
        raise error
    print(f"hlp: {in_words(error)}", file=sys.stderr)
    sys.exit(1)


def in_words(error: BaseException) -> str:
    """The message of an error and its notes; one of the configuration in one sentence."""
    lines = [str(error)]
    if _is_of_configuration(error):
        from hlp.commands.composing import hydra_in_words  # Hydra is slow, and not always used

        words = hydra_in_words(error)
        cause = str(error.__cause__ or "").partition("\n")[0] if words == str(error) else ""
        lines = [words, *filter(None, [cause])]
    return "\n".join(map(shortened, [*lines, *getattr(error, "__notes__", [])]))


def is_foreseen(error: BaseException) -> bool:
    """Whether an error is HLP's own, one of the system, or of the configuration: no bug."""
    return is_expected(error) or _is_of_configuration(error)


def _is_of_configuration(error: BaseException) -> bool:
    return type(error).__module__.partition(".")[0] in _CONFIGURING


def _reader_has_gone() -> bool:
    """Whether standard output is a pipe whose other end is closed."""
    output = select.poll()
    output.register(1, 0)
    return any(event & select.POLLERR for _, event in output.poll(0))


def _terminate(number: int, frame: FrameType | None) -> NoReturn:
    signal.signal(signal.SIGTERM, signal.SIG_IGN)
    raise TerminatedError
