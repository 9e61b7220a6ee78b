"""What the targets of the Makefile that README names would run."""

import os
import shutil
import subprocess

import pytest
from markdown_pages import ROOT

pytestmark = pytest.mark.skipif(shutil.which("make") is None, reason="make is not installed")

_VARIABLES = ("BROWSER", "PORT", "SLOW", "WORK", "WORKERS")


def commands(*words: str) -> list[str]:
    """The lines that `make` would run where .venv is made already.

    The `make` that runs this test, perhaps with variables of its own, passes nothing on to it.
    """
    own = {
        key: value for key, value in os.environ.items() if not key.startswith(("MAKE", "MFLAGS"))
    }
    done = subprocess.run(
        ["make", "--dry-run", "--assume-old=.venv/.installed", *words],
        cwd=ROOT,
        env={key: value for key, value in own.items() if key not in _VARIABLES},
        capture_output=True,
        text=True,
        check=True,
    )
    return done.stdout.splitlines()


def test_demo_is_a_run_and_ui_shows_it() -> None:
    assert commands("demo", "WORK=there") == [".venv/bin/hlp run work=there"]
    assert commands("ui", "WORK=there", "PORT=5001") == [".venv/bin/hlp ui work=there port=5001"]


def test_a_browser_can_be_demanded() -> None:
    (line,) = commands("test-slow", "BROWSER=required")
    assert line.startswith("HLP_BROWSER=required .venv/bin/python -m pytest ")
    assert line.endswith('-m "slow"')


def test_a_part_of_the_slow_tests_can_be_chosen() -> None:
    (line,) = commands("test-slow", "SLOW=slow and not thorough")
    assert line.endswith('-m "slow and not thorough"')


def test_screenshots_show_a_run_and_a_sweep_of_their_own() -> None:
    run, sweep, pictures = commands("screenshots")
    assert run.startswith(".venv/bin/hlp run work=build/screenshots/work ")
    assert sweep.startswith(".venv/bin/hlp -m ") and "work=build/screenshots/work " in sweep
    assert "tests/browser" in pictures and "--screenshots=docs/assets" in pictures
