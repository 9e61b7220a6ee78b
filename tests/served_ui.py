"""`hlp ui` in a process of its own, as README says to start it."""

import os
import socket
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import hlp


@contextmanager
def served_ui(work: Path) -> Iterator[str]:
    """`hlp ui` of this folder while the block runs; the page that it names. SIGTERM ends it."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    words = ("ui", f"work={work}", f"port={port}", "open=false")
    process = subprocess.Popen(
        [sys.executable, "-c", "from hlp.cli import main; main()", *words],
        env={**os.environ, "PYTHONPATH": str(Path(hlp.__file__).parents[1])},
        stdout=subprocess.PIPE,
        text=True,
    )
    assert process.stdout is not None
    try:
        line = process.stdout.readline()
        assert line.startswith(f"Runs: http://127.0.0.1:{port}/"), line
        yield line.removeprefix("Runs: ").strip()
    finally:
        process.terminate()  # as Ctrl-C, which is ignored below the background of a shell
        process.stdout.close()
        assert process.wait(60) == 0
