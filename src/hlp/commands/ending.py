"""How a command ends when it is stopped: one line, the exit code of shells, no worker left."""

import os
import select
import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType
from typing import NoReturn

INTERRUPTED, READER_GONE, TERMINATED = 130, 141, 143


class TerminatedError(KeyboardInterrupt):
    """The process was asked to end by SIGTERM; libraries treat it as they treat Ctrl-C."""


@contextmanager
def stops_in_one_line(continues: bool = True) -> Iterator[None]:
    """In the block, SIGTERM ends the process as Ctrl-C does: what is open is closed first.

    The process prints one line and exits with 130 (SIGINT) or 143 (SIGTERM); the line says so if
    the same command `continues` from there. A second SIGTERM changes nothing; SIGKILL always works,
    and what it leaves behind is put in order by the next run. The process exits with 141 and
    silently where nobody reads standard output any more, as in `hlp runs | head`. Without
    effect outside the main thread.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
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


def _reader_has_gone() -> bool:
    """Whether standard output is a pipe whose other end is closed."""
    output = select.poll()
    output.register(1, 0)
    return any(event & select.POLLERR for _, event in output.poll(0))


def _terminate(number: int, frame: FrameType | None) -> NoReturn:
    signal.signal(signal.SIGTERM, signal.SIG_IGN)
    raise TerminatedError
