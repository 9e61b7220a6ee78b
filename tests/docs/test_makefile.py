"""What the targets of the Makefile that README names would run."""

import os
import shutil
import subprocess

import pytest
from markdown_pages import ROOT

pytestmark = pytest.mark.skipif(shutil.which("make") is None, reason="make is not installed")


def commands(*words: str) -> list[str]:
    """The lines that `make` would run where .venv is made already.

    The `make` that runs this test, perhaps with variables of its own, passes nothing on to it.
    """
    own = ("MAKE", "MFLAGS", "BROWSER", "PORT", "SLOW", "WORK")
    done = subprocess.run(
        ["make", "--dry-run", "--assume-old=.venv/.installed", *words],
        cwd=ROOT,
        env={name: value for name, value in os.environ.items() if not name.startswith(own)},
        capture_output=True,
        text=True,
        check=True,
    )
    return done.stdout.splitlines()


def test_demo_is_a_run_and_ui_shows_it() -> None:
    assert commands("demo", "WORK=there") == [".venv/bin/hlp run work=there"]
    assert commands("ui", "WORK=there", "PORT=5001") == [".venv/bin/hlp ui work=there port=5001"]


def test_a_part_of_the_slow_tests_can_be_chosen_and_a_browser_demanded() -> None:
    (line,) = commands("test-slow", "BROWSER=required", "SLOW=slow and not thorough")
    assert line.startswith("HLP_BROWSER=required .venv/bin/python -m pytest ")
    assert line.endswith('-m "slow and not thorough"')


def test_screenshots_show_a_run_and_a_sweep_of_their_own() -> None:
    run, sweep, pictures = commands("screenshots")
    assert run.startswith(".venv/bin/hlp run work=build/screenshots/work ")
    assert sweep.startswith(".venv/bin/hlp -m ") and "work=build/screenshots/work " in sweep
    assert "tests/browser" in pictures and "--screenshots=docs/assets" in pictures
