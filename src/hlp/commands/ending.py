"""How a command ends when it is stopped: one line, the exit code of shells, no worker left."""

import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType
from typing import NoReturn

INTERRUPTED, TERMINATED = 130, 143


class TerminatedError(KeyboardInterrupt):
    """The process was asked to end by SIGTERM; libraries treat it as they treat Ctrl-C."""


@contextmanager
def stops_in_one_line() -> Iterator[None]:
    """In the block, SIGTERM ends the process as Ctrl-C does: what is open is closed first.

    The process prints one line and exits with 130 (SIGINT) or 143 (SIGTERM). A second SIGTERM
    changes nothing; SIGKILL always works, and what it leaves behind is put in order by the next
    run. Without effect outside the main thread.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.signal(signal.SIGTERM, _terminate)
    try:
        yield
    except KeyboardInterrupt as error:
        terminated = isinstance(error, TerminatedError)
        what = "terminated" if terminated else "interrupted"
        print(f"hlp: {what}; the same command continues from here", file=sys.stderr)
        sys.exit(TERMINATED if terminated else INTERRUPTED)
    finally:
        signal.signal(signal.SIGTERM, before)


def _terminate(number: int, frame: FrameType | None) -> NoReturn:
    signal.signal(signal.SIGTERM, signal.SIG_IGN)
    raise TerminatedError
