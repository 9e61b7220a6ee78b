"""Where and how the tests of this folder disturb `hlp` in processes of their own."""

import ctypes
import functools
import os
import pkgutil
import resource
import signal
import time
from functools import partial
from pathlib import Path

from forked_hlp import run_hlp

PLACES = {
    "database begun": ("hlp.reporting.mlflow", "artifacts_uri", 0),
    "database made": ("hlp.reporting.mlflow.os", "replace", 1),
    "views half written": ("hlp.rendering.views", "write_array", 2),
    "epoch": ("hlp.method.learn.training", "write_csv", 0),
    "network half written": ("hlp.models.onnx_export.onnx", "save", 1),
    "checksums": ("hlp.stages.store", "folder_checksums", 0),
    "renaming": ("hlp.stages.store", "_flush", 0),
    "frame": ("hlp.stages.detection", "search_frame", 2),
    "frame half written": ("hlp.stages.trace_files", "write_arrays", 1),
    "frame of a worker": ("hlp.runs.runner", "note_frame", 0),
    "scores": ("hlp.runs.runner", "write_scores", 0),
    "manifest": ("hlp.runs.runner", "make_manifest", 0),
}
"""Module, function, and the number of its calls that still go well, in the order of a run."""

LEARNING_PLACES = {
    **{name: PLACES[name] for name in ("views half written", "epoch", "network half written")},
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
    "first answer": ("hlp.results.poses_file.AnswersFile", "add", 0),
    "second answer": ("hlp.results.poses_file.AnswersFile", "add", 1),
    "last answer": ("hlp.results.poses_file.AnswersFile", "_write_json", 0),
    "run created": ("hlp.reporting.mlflow.upload", "_send_values", 0),
    "artifacts sent": ("hlp.reporting.mlflow.upload.tempfile", "TemporaryDirectory", 0),
    "run sent": ("hlp.reporting.mlflow.upload", "remove_database", 0),
}
"""Places in other commands."""

SWEEP_PLACES = {
    "sweep opened": ("hlp.studies.sweep", "_recorded", 0),
    "setting begun": ("hlp.runs.manifest", "is_finished", 0),
    "setting half done": ("hlp.runs.runner", "write_scores", 0),
    "second setting begun": ("hlp.runs.manifest", "is_finished", 1),
    "tables of the sweep": ("hlp.reporting.sweep_report", "describe_sweep", 0),
}
"""Likewise, in the order of a sweep of two settings."""

BOP_PLACES = {
    "network half written": PLACES["network half written"],
    "frame": PLACES["frame"],
    "files for the server": ("hlp.reporting.bop_table", "write_csv", 1),
}
"""Likewise, in the order of `experiment=bop` on two sets."""

CODES = {signal.SIGKILL: -9, signal.SIGTERM: 143, signal.SIGINT: 130}
"""What a process returns after a signal."""
LINES = {
    143: "hlp: terminated; the same command continues from here\n",
    130: "hlp: interrupted; the same command continues from here\n",
}
"""What it says, by that number."""


def stop_hlp(folder, place, number, *arguments):
    """Call `hlp`, which gets a signal at a place, and then is gone with all its workers."""
    places = PLACES | LEARNING_PLACES | COMMAND_PLACES | SWEEP_PLACES | BOP_PLACES
    ended = run_hlp(folder, *arguments, first=[partial(stop_at, *places[place], number)])
    assert ended.returncode == CODES[signal.Signals(number)], (place, ended.stderr)
    assert wait_until_gone(folder), place
    return ended


def stop_at(module, name, calls, number):
    """Replace a function by one that sends this process a signal after some calls.

    One of another library's is given by the module of HLP that calls it: hlp.files.os.
    """
    target = pkgutil.resolve_name(module)
    whole, left = getattr(target, name), [calls]

    @functools.wraps(whole)
    def stopped(*given, **named):
        left[0] -= 1
        if left[0] == -1:
            os.kill(os.getpid(), number)
        return whole(*given, **named)

    setattr(target, name, stopped)


def limit_files(longest):
    """No file of this process becomes longer than so many bytes."""
    # Python turns the signal that comes with it into EFBIG.
    resource.setrlimit(resource.RLIMIT_FSIZE, (longest, resource.RLIM_INFINITY))


def obey_permissions():
    """Give up root's right to read and write everything, where this process has it (Linux)."""
    header = (ctypes.c_uint32 * 2)(0x20080522, 0)  # version 3 of the interface, this process
    sets = (ctypes.c_uint32 * 6)()  # effective, permitted, inheritable, each of 64 bits
    libc = ctypes.CDLL(None, use_errno=True)
    assert libc.capget(header, sets) == 0
    for index in range(3):
        sets[index] &= ~0b110  # CAP_DAC_OVERRIDE, CAP_DAC_READ_SEARCH
    assert libc.capset(header, sets) == 0


def wait_until_gone(folder, seconds=20.0):
    """Whether no process works in a folder any more, at the latest after some seconds (Linux)."""
    end = time.monotonic() + seconds
    while _is_used(folder) and time.monotonic() < end:
        time.sleep(0.05)
    return not _is_used(folder)


def _is_used(folder):
    for process in Path("/proc").glob("[0-9]*"):
        try:
            if (process / "cwd").readlink() == folder:
                return True
        except OSError:
            continue
    return False
