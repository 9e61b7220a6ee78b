"""`hlp …` in processes forked from one that has imported all libraries, which takes seconds."""

import multiprocessing
import os
import sys
import traceback
from collections.abc import Sequence
from dataclasses import dataclass
from multiprocessing.context import ForkServerContext
from pathlib import Path

_PRELOADED = ["mlflow", "pytorch_lightning", "onnx", "trimesh", "matplotlib.pyplot"]
_PRELOADED += ["mlflow.store.tracking.sqlalchemy_store"]  # takes a second, in each process
_PRELOADED += ["hlp.cli", "hlp.runs.runner", "hlp.studies.sweep", "hlp.method.detector"]


@dataclass(frozen=True)
class Ended:
    """Exit code and what was printed."""

    code: int
    out: str
    err: str


class ForkedProcesses:
    """Runs commands of `hlp` in a folder, one after another, each in a process of its own."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._context: ForkServerContext = multiprocessing.get_context("forkserver")
        self._context.set_forkserver_preload(_PRELOADED)

    def call(self, words: Sequence[str], given: str = "", limit: float = 300.0) -> Ended:
        """`hlp WORDS…` with this standard input."""
        files = [self.folder / f".std{name}" for name in ("in", "out", "err")]
        files[0].write_text(given)
        process = self._context.Process(target=_child, args=(list(words), self.folder, files))
        process.start()
        process.join(limit)
        if process.exitcode is None:
            process.kill()
            process.join()
        code = process.exitcode
        assert code is not None
        process.close()
        return Ended(code, files[1].read_text(), files[2].read_text())


def _child(words: list[str], folder: Path, files: list[Path]) -> None:
    os.chdir(folder)
    for number, path in enumerate(files):
        os.dup2(os.open(path, os.O_RDWR | os.O_CREAT | (os.O_TRUNC if number else 0)), number)
    from hlp.cli import main

    sys.argv = ["hlp", *words]
    sys.path.insert(0, str(folder))  # what a camera's vendor installs
    try:
        main()
    except SystemExit:
        raise
    except BaseException:
        traceback.print_exc()
        sys.exit(70)
    finally:
        sys.stdout.flush()
        sys.stderr.flush()
