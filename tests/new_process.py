"""Code that needs a process of its own: for what it imports, how it ends or what it says."""

import os
import subprocess
import sys
from pathlib import Path

import hlp


def run_python(
    code: str, folder: Path | None = None, **variables: str
) -> subprocess.CompletedProcess[str]:
    """What became of Python with this code, in a folder and with further environment variables."""
    own = {"PYTHONPATH": str(Path(hlp.__file__).parents[1]), **variables}
    return subprocess.run(
        [sys.executable, "-c", code],
        cwd=folder,
        env={**os.environ, **own},
        capture_output=True,
        text=True,
        check=False,
        timeout=300,
    )


def printed_by(code: str, folder: Path | None = None, **variables: str) -> str:
    """What it prints; it must end well."""
    done = run_python(code, folder, **variables)
    assert done.returncode == 0, done.stderr
    return done.stdout
