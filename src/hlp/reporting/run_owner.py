"""Which process a run belongs to, so that the next one can close the runs of dead processes."""

import os
import platform
import sys
from collections.abc import Mapping
from pathlib import Path

_HOST, _PROCESS, _STARTED = "hlp.host", "hlp.process", "hlp.process_started"


def owner_tags() -> dict[str, str]:
    """Tags that name this process: host, id, and when it started (another may get its id)."""
    own = os.getpid()
    return {_HOST: platform.node(), _PROCESS: str(own), _STARTED: _state_and_start(own)[1]}


def owner_is_dead(tags: Mapping[str, str]) -> bool:
    """Whether the process that a run's tags name has ended; False if that cannot be known."""
    number = tags.get(_PROCESS, "")
    if tags.get(_HOST) != platform.node() or not number.isdecimal() or sys.platform == "win32":
        return False
    try:
        os.kill(int(number), 0)
    except (ProcessLookupError, OverflowError):
        return True
    except PermissionError:
        pass  # it is another user's
    state, started = _state_and_start(int(number))
    return state == "Z" or started != tags.get(_STARTED, "")


def _state_and_start(process: int) -> tuple[str, str]:
    """State and start time (ticks since boot) of a process on Linux; empty elsewhere."""
    try:
        text = Path(f"/proc/{process}/stat").read_text()
    except OSError:
        return "", ""
    fields = text.rpartition(")")[2].split()  # its name, in brackets, may have blanks
    return fields[0], fields[19]
