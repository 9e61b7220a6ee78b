"""A real browser. Where there is none, the tests are skipped, or fail with HLP_BROWSER=required."""

import os
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, NoReturn

import pytest
from page import ShownRuns

from hlp.reporting.sweeps import read_sweeps
from tiny_run import TinyRun, start_run

if TYPE_CHECKING:
    from selenium.webdriver import Chrome


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--screenshots", help="folder that pictures of the pages are written into")
    parser.addoption("--shown", help="folder of finished runs to show, with work/ and outputs/")


@pytest.fixture(scope="session")
def programs() -> tuple[str, str]:
    """The browser and its driver. For the whole session, so that without them no run is made."""
    pytest.importorskip("selenium", reason="selenium is not installed (extra 'dev')")
    chromium = shutil.which("chromium") or shutil.which("google-chrome")
    driver = shutil.which("chromedriver")
    if chromium is None or driver is None:
        _lacking("no Chromium with its driver here (Debian: chromium and chromium-driver)")
    return chromium, driver


@pytest.fixture
def browser(programs: tuple[str, str]) -> Iterator["Chrome"]:
    from selenium.common.exceptions import WebDriverException
    from selenium.webdriver import Chrome, ChromeOptions
    from selenium.webdriver.chrome.service import Service

    chromium, driver = programs
    options = ChromeOptions()
    options.binary_location = chromium
    options.set_capability("goog:loggingPrefs", {"browser": "ALL"})
    for option in ("--headless=new", "--window-size=1440,900", "--disable-dev-shm-usage"):
        options.add_argument(option)
    if hasattr(os, "geteuid") and os.geteuid() == 0:
        options.add_argument("--no-sandbox")  # Chromium refuses to start as root with it
    try:
        started = Chrome(options, Service(driver))
    except WebDriverException as error:
        _lacking(f"{chromium} does not start: {error.msg}")
    started.set_page_load_timeout(120)
    try:
        yield started
    finally:
        started.quit()


def _lacking(what: str) -> NoReturn:
    """Skip what needs a browser, or fail where one is demanded (`make test-slow`)."""
    if os.environ.get("HLP_BROWSER") == "required":
        pytest.fail(what)
    pytest.skip(what)


@pytest.fixture(scope="session")
def screenshots(request: pytest.FixtureRequest) -> Path | None:
    given = request.config.getoption("--screenshots", default=None)
    return None if given is None else Path(given)


@pytest.fixture(scope="session")
def shown(request: pytest.FixtureRequest, programs: tuple[str, str]) -> ShownRuns:
    """The tiny run and a sweep of it; or, for pictures, what `make screenshots` has made."""
    given = request.config.getoption("--shown", default=None)
    if given is None:
        tiny: TinyRun = request.getfixturevalue("tiny_run")
        swept = ("-m", *tiny.overrides, "refinement.particles=5,6", "output=shown")
        done = start_run(tiny.folder, *swept, threads=1)
        assert done.returncode == 0, done.stderr
        folder, run, sweep = tiny.folder, tiny.output, tiny.folder / "shown"
    else:
        folder = Path(given).absolute()
        run, sweep = folder / "run", folder / "sweep"
    (found,) = read_sweeps(sweep)
    (key,) = found.keys
    values = tuple(result.chosen[key] for result in found.results)
    last = key.rpartition(".")[2]
    names = tuple(f"{last} {value}" if "." in key else value for value in values)
    recalls = tuple(result.add["recall"] for result in found.results)
    return ShownRuns(folder / "work", run, sweep, values, names, recalls, last)
