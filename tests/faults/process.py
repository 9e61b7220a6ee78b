"""`hlp` in processes of their own: stopped at a named place, or with something taken from them.

They are forked from a process that has imported everything once (multiprocessing's forkserver),
because importing costs more than most of what these tests look at.
"""

import ctypes
import functools
import importlib
import itertools
import multiprocessing
import os
import pkgutil
import resource
import signal
import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import Any

import hlp

PLACES = {
    "database begun": ("hlp.reporting.local_database", "artifacts_uri", 0),
    "database made": ("hlp.reporting.local_database.os", "replace", 1),
    "run opened": ("hlp.runs.runner", "log_inputs", 0),
    "views begun": ("hlp.rendering.views", "_poses", 1),
    "views half written": ("hlp.rendering.views", "write_array", 2),
    "windows": ("hlp.method.learn.classifier_training", "bake_windows", 1),
    "epoch": ("hlp.method.learn.training", "write_csv", 0),
    "checkpoint": ("hlp.method.learn.checkpoints", "content_checksum", 0),
    "weights": ("hlp.method.learn.training", "save", 0),
    "network half written": ("hlp.models.onnx_export.onnx", "save", 1),
    "checksums": ("hlp.stages.store", "folder_checksums", 0),
    "renaming": ("hlp.stages.store", "_flush", 0),
    "codebook": ("hlp.codebook.entries.np", "savez", 1),
    "frame": ("hlp.stages.detection", "search_frame", 2),
    "frame half written": ("hlp.stages.detection", "write_arrays", 1),
    "frame of a worker": ("hlp.runs.runner", "note_frame", 0),
    "one of three stages": ("hlp.stages.store", "_flush", 1),
    "scores": ("hlp.runs.runner", "write_scores", 0),
    "tables": ("hlp.runs.runner", "log_tables", 0),
    "manifest": ("hlp.runs.runner", "make_manifest", 0),
}
"""Module, function, and the number of its calls that still go well, in the order of a run."""

LEARNING_PLACES = {
    **{
        name: PLACES[name]
        for name in (
            *("views begun", "views half written", "windows", "epoch", "checkpoint", "weights"),
            *("network half written", "codebook"),
        )
    },
    "scenes of the score": ("hlp.method.learn.score_calibration", "search_scenes", 1),
    "record": ("hlp.method.learn.unfinished_folder", "write_record", 0),
    "renaming of the folder": ("hlp.method.learn.unfinished_folder", "_publish", 0),
    "folder in its place": ("hlp.method.learn.unfinished_folder", "_remove_markers", 0),
}
"""Likewise, in the order of `hlp learn` with two objects."""

COMMAND_PLACES = {
    "copy begun": ("hlp.runs.learnt_cache.shutil", "copystat", 2),
    "copy made": ("hlp.runs.learnt_cache.Path", "rename", 0),
    "entry hidden": ("hlp.runs.learnt_cache.shutil", "rmtree", 0),
    "entry half removed": ("hlp.runs.learnt_cache.shutil.os", "unlink", 2),
    "first answer": ("hlp.results.answers_file.AnswersFile", "add", 0),
    "second answer": ("hlp.results.answers_file.AnswersFile", "add", 1),
    "last answer": ("hlp.results.answers_file.AnswersFile", "_write_json", 0),
    "first image": ("hlp.runs.live", "_line", 0),
    "second image": ("hlp.runs.live", "_line", 1),
    "page half written": ("hlp.files.os", "replace", 0),
    "run created": ("hlp.reporting.unsent_runs", "_send_values", 0),
    "artifacts sent": ("hlp.reporting.unsent_runs.tempfile", "TemporaryDirectory", 0),
    "run sent": ("hlp.reporting.unsent_runs", "remove_database", 0),
}
"""Places in other commands."""

SWEEP_PLACES = {
    "sweep opened": ("hlp.studies.sweep", "_recorded", 0),
    "arm begun": ("hlp.runs.manifest", "is_finished", 0),
    "arm half done": ("hlp.runs.runner", "write_scores", 0),
    "second arm begun": ("hlp.runs.manifest", "is_finished", 1),
    "tables of the sweep": ("hlp.reporting.sweep_report", "describe_sweep", 0),
}
"""Likewise, in the order of a sweep of two arms."""

CODES = {signal.SIGKILL: -9, signal.SIGTERM: 143, signal.SIGINT: 130}
"""What a process returns after a signal."""
LINES = {
    143: "hlp: terminated; the same command continues from here\n",
    130: "hlp: interrupted; the same command continues from here\n",
}
"""What it says, by that number."""

# All but `blinn_phong`, which `opengl` imports once rendering has started.
_MODULES = [each.name for each in pkgutil.walk_packages(hlp.__path__, "hlp.")]
_IMPORTED = [name for name in _MODULES if name != "hlp.rendering.blinn_phong"]
_IMPORTED += ["matplotlib.pyplot", "mlflow.store.tracking.sqlalchemy_store"]
_numbers = itertools.count()
_CONTEXT = multiprocessing.get_context("forkserver")
_CONTEXT.set_forkserver_preload(_IMPORTED)


@dataclass(frozen=True)
class Ended:
    """What a process that has ended returned (-n: killed by signal n) and printed."""

    returncode: int
    stdout: str
    stderr: str


@dataclass(frozen=True)
class Limits:
    """What a process gets and what it lacks; without any, it is as any other.

    `place` is a key of one of the tables of places, where it gets the signal `number`. A file
    becomes no longer than `longest_file` bytes. With `rights` false, permissions hold for root too.
    """

    place: str = ""
    number: int = 0
    longest_file: int | None = None
    rights: bool = True
    environment: Mapping[str, str] = field(default_factory=dict)


class Running:
    """`hlp` at work in a folder, in the background."""

    def __init__(self, folder: Path, *arguments: str, **limits: Any) -> None:
        self._printed = folder.parent / f"{folder.name}-{next(_numbers)}"
        given = (str(hlp.__file__), folder, arguments, Limits(**limits), self._printed)
        self.process: BaseProcess = _CONTEXT.Process(target=_call, args=given)
        self.process.start()

    def wait(self) -> Ended:
        """Until it has ended."""
        self.process.join(timeout=600)
        code = self.process.exitcode
        assert code is not None, "it goes on for ever"
        out, error = (Path(f"{self._printed}.{name}").read_text() for name in ("out", "err"))
        return Ended(code, out, error)


def run_hlp(folder: Path, *arguments: str, **limits: Any) -> Ended:
    """Call `hlp` in a folder, with `Limits`, and wait until it has ended."""
    return Running(folder, *arguments, **limits).wait()


def wait_until_gone(folder: Path, seconds: float = 20.0) -> bool:
    """Whether no process works in a folder any more, at the latest after some seconds (Linux)."""
    end = time.monotonic() + seconds
    while _working_in(folder) and time.monotonic() < end:
        time.sleep(0.05)
    return not _working_in(folder)


def _working_in(folder: Path) -> set[str]:
    found = set()
    for process in Path("/proc").glob("[0-9]*"):
        try:
            if (process / "cwd").readlink() == folder:
                found.add(process.name)
        except OSError:
            continue
    return found


def _call(code: str, folder: Path, arguments: tuple[str, ...], limits: Limits, out: Path) -> None:
    """In the new process."""
    assert hlp.__file__ == code, "the tests of one checkout with the code of another"
    os.chdir(folder)
    for descriptor, name in ((1, "out"), (2, "err")):
        os.dup2(os.open(f"{out}.{name}", os.O_WRONLY | os.O_CREAT), descriptor)
    # A run in the background of a shell script starts with Ctrl-C ignored, and so would this one.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    os.environ.update(limits.environment)
    if limits.longest_file is not None:  # Python turns the signal that comes with it into EFBIG
        resource.setrlimit(resource.RLIMIT_FSIZE, (limits.longest_file, resource.RLIM_INFINITY))
    if not limits.rights:
        _obey_permissions()
    if limits.place:
        places = {**PLACES, **LEARNING_PLACES, **COMMAND_PLACES, **SWEEP_PLACES}
        _arm(places[limits.place], limits.number)
    from hlp.cli import main

    main(arguments)


def _arm(place: tuple[str, str, int], number: int) -> None:
    """Replace the place's function by one that sends this process a signal first."""
    module, name, calls = place
    # A place of another library's is given by the module of HLP that calls it: hlp.files.os.
    parts = module.split(".")
    known = next(n for n in range(len(parts), 0, -1) if _is_module(".".join(parts[:n])))
    found = importlib.import_module(".".join(parts[:known]))
    target = functools.reduce(getattr, parts[known:], found)
    whole, left = getattr(target, name), [calls]

    @functools.wraps(whole)
    def stopped(*given: Any, **named: Any) -> Any:
        left[0] -= 1
        if left[0] == -1:
            os.kill(os.getpid(), number)
        return whole(*given, **named)

    setattr(target, name, stopped)


def _is_module(name: str) -> bool:
    try:
        importlib.import_module(name)
    except ImportError:
        return False
    return True


def _obey_permissions() -> None:
    """Give up root's right to read and write everything, where this process has it (Linux)."""
    header = (ctypes.c_uint32 * 2)(0x20080522, 0)  # version 3 of the interface, this process
    sets = (ctypes.c_uint32 * 6)()  # effective, permitted, inheritable, each of 64 bits
    libc = ctypes.CDLL(None, use_errno=True)
    assert libc.capget(header, sets) == 0
    for index in range(3):
        sets[index] &= ~0b110  # CAP_DAC_OVERRIDE, CAP_DAC_READ_SEARCH
    assert libc.capset(header, sets) == 0
