"""`hlp` in a process of its own, which gets a signal at a named place."""

import os
import subprocess
import sys
from pathlib import Path

import hlp

PLACES = {
    "database begun": ("hlp.reporting.local_database", "artifacts_uri", 0),
    "database made": ("hlp.reporting.local_database.os", "replace", 1),
    "run opened": ("hlp.runs.runner", "log_inputs", 0),
    "views begun": ("hlp.rendering.views", "_poses", 1),
    "views half written": ("hlp.rendering.views.np", "save", 6),
    "windows": ("hlp.method.classifier_training", "bake_windows", 1),
    "epoch": ("hlp.method.training", "write_csv", 0),
    "checkpoint": ("hlp.method.checkpoints", "content_checksum", 0),
    "weights": ("hlp.method.training", "save_file", 0),
    "network half written": ("hlp.models.onnx_export.onnx", "save", 1),
    "checksums": ("hlp.stages.store", "folder_checksums", 0),
    "renaming": ("hlp.stages.store", "_flush", 0),
    "codebook": ("hlp.codebook.entries.np", "savez", 1),
    "frame": ("hlp.stages.detection", "find_in_frame", 2),
    "frame half written": ("hlp.stages.detection", "write_arrays", 1),
    "frame of a worker": ("hlp.runs.runner", "note_frame", 0),
    "one of three stages": ("hlp.stages.store", "_flush", 1),
    "scores": ("hlp.runs.runner", "write_scores", 0),
    "tables": ("hlp.runs.runner", "log_tables", 0),
    "manifest": ("hlp.runs.runner", "make_manifest", 0),
}
"""Module, function, and the number of its calls that still go well, in the order of a run."""

_DRIVER = """
import functools, importlib, os, signal
# A run in the background of a shell script starts with Ctrl-C ignored, and so would its children.
signal.signal(signal.SIGINT, signal.default_int_handler)
module, name, calls = {place!r}

def arm():
    target, parts = None, module.split(".")
    for count in range(len(parts), 0, -1):
        try:
            target = importlib.import_module(".".join(parts[:count]))
            break
        except ImportError:
            continue
    for part in parts[count:]:
        target = getattr(target, part)
    whole, left = getattr(target, name), [calls]

    @functools.wraps(whole)
    def stopped(*given, **named):
        left[0] -= 1
        if left[0] == -1:
            os.kill(os.getpid(), {number})
        return whole(*given, **named)

    setattr(target, name, stopped)

if module:
    arm()
from hlp.cli import main
main()
"""


def run_hlp(
    folder: Path, *arguments: str, place: str = "", number: int = 0
) -> "subprocess.CompletedProcess[str]":
    """`hlp` in a folder; with a `place`, the process gets the signal of that number there."""
    code = _DRIVER.format(place=PLACES[place] if place else ("", "", 0), number=int(number))
    environment = {**os.environ, "PYTHONPATH": str(Path(hlp.__file__).parents[1])}
    return subprocess.run(
        [sys.executable, "-c", code, *arguments],
        cwd=folder,
        env=environment,
        capture_output=True,
        text=True,
        check=False,
        timeout=300,
    )
