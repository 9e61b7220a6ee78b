"""What the targets of the Makefile that README names would run."""

import os
import shutil
import subprocess

import pytest
from markdown_pages import ROOT

OWN_WORK = "work=build/screenshots/work "
DOCS = ("pip install ", "touch ", "mkdocs build ", "Pages: ")


@pytest.mark.skipif(shutil.which("make") is None, reason="make is not installed")
@pytest.mark.parametrize(
    ("words", "run"),
    [
        (["demo", "WORK=there"], ["minutes", "hlp run work=there"]),
        (["ui", "WORK=there", "PORT=5001"], ["hlp ui work=there port=5001"]),
        (["test-slow", "SLOW=slow and not thorough"], [' -m "slow and not thorough"']),
        (["test-slow", "BROWSER=required"], ["HLP_BROWSER=required .venv/bin/python -m pytest "]),
        (["screenshots"], [*DOCS, OWN_WORK, OWN_WORK, "tests/browser --shown=build/", "cp "]),
    ],
)
def test_targets_run_what_readme_says(words: list[str], run: list[str]) -> None:
    """The `make` that runs this test, perhaps with variables of its own, passes nothing on."""
    own = ("MAKE", "MFLAGS", "BROWSER", "PORT", "SLOW", "WORK")
    done = subprocess.run(
        ["make", "--dry-run", "--what-if=.venv/.installed", *words],
        cwd=ROOT,
        env={name: value for name, value in os.environ.items() if not name.startswith(own)},
        capture_output=True,
        text=True,
        check=True,
    )
    lines = done.stdout.splitlines()
    assert all(words in line for words, line in zip(run, lines, strict=True))
