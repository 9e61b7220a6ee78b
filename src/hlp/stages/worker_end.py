"""A worker process does not outlive the run that started it."""

import os
import signal
import threading
import time
from functools import cache

_EVERY = 0.2  # s


@cache
def ends_with(parent: int) -> None:
    """End this process soon after its parent, however that ends; leave Ctrl-C to the parent.

    Otherwise a worker would finish its work, writing into folders whose locks are free already.
    `parent` is the parent's process id. A second call has no effect.
    """
    if threading.current_thread() is threading.main_thread():
        signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_watch, args=(parent,), name="parent", daemon=True).start()


def _watch(parent: int) -> None:
    while os.getppid() == parent:
        time.sleep(_EVERY)
    os._exit(1)
