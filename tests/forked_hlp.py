"""`hlp` in processes forked from one that has imported everything (multiprocessing's forkserver).

Importing costs more than most of what the tests look at.
"""

import itertools
import multiprocessing
import os
import pkgutil
import signal
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from multiprocessing.process import BaseProcess
from pathlib import Path

import hlp

# All but `blinn_phong`, which `opengl` imports once rendering has started.
_IMPORTED = [module.name for module in pkgutil.walk_packages(hlp.__path__, "hlp.")]
_IMPORTED.remove("hlp.rendering.blinn_phong")
_IMPORTED += ["matplotlib.pyplot", "mlflow.store.tracking.sqlalchemy_store"]
os.environ.setdefault("OPENCV_LOG_LEVEL", "ERROR")  # as `hlp` does, before OpenCV is imported
_CONTEXT = multiprocessing.get_context("forkserver")
_CONTEXT.set_forkserver_preload(_IMPORTED)
_numbers = itertools.count()


@dataclass(frozen=True)
class Ended:
    """What a process that has ended returned (-n: killed by signal n) and printed."""

    returncode: int
    stdout: str
    stderr: str


class Running:
    """`hlp` at work in a folder, in the background; `first` is called before it begins."""

    def __init__(
        self,
        folder: Path,
        *arguments: str,
        stdin: str = "",
        first: Sequence[Callable[[], object]] = (),
    ) -> None:
        self._streams = folder.parent / f"{folder.name}-{next(_numbers)}"
        self._streams.mkdir()
        (self._streams / "in").write_text(stdin)
        given = (str(hlp.__file__), folder, arguments, self._streams, first)
        self.process: BaseProcess = _CONTEXT.Process(target=_call, args=given)
        self.process.start()

    def wait(self, seconds: float = 600.0) -> Ended:
        """Until it has ended, or is killed after some seconds."""
        self.process.join(seconds)
        if self.process.exitcode is None:
            self.process.kill()
            self.process.join()
        assert self.process.exitcode is not None
        out, error = ((self._streams / name).read_text() for name in ("out", "err"))
        return Ended(self.process.exitcode, out, error)


def run_hlp(
    folder: Path, *arguments: str, stdin: str = "", first: Sequence[Callable[[], object]] = ()
) -> Ended:
    """Call `hlp` in a folder and wait until it has ended."""
    return Running(folder, *arguments, stdin=stdin, first=first).wait()


def succeed(folder: Path, *arguments: str) -> Ended:
    """Likewise; it must end well."""
    ended = run_hlp(folder, *arguments)
    assert ended.returncode == 0, ended.stderr
    return ended


def _call(
    code: str,
    folder: Path,
    arguments: tuple[str, ...],
    streams: Path,
    first: Sequence[Callable[[], object]],
) -> None:
    """In the new process."""
    assert hlp.__file__ == code, "the tests of one checkout with the code of another"
    os.chdir(folder)
    sys.path.insert(0, str(folder))  # as for `python -c`: what a camera's vendor installs
    for descriptor, name in enumerate(("in", "out", "err")):
        os.dup2(os.open(streams / name, os.O_RDWR | os.O_CREAT), descriptor)
    # A run in the background of a shell script starts with Ctrl-C ignored, and so would this one.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    for prepare in first:
        prepare()
    from hlp.cli import main

    sys.argv = ["hlp", *arguments]
    main()
