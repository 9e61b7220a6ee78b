"""MLflow as README says to open it, in a real browser: runs, columns, numbers, images."""

import os
import socket
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from page import errors, has_words, take_picture, text_of, wait
from shown_runs import ShownRuns

import hlp

if TYPE_CHECKING:
    from selenium.webdriver import Chrome


@contextmanager
def served(work: Path) -> Iterator[str]:
    """`hlp ui` of this folder while the block runs; the address that it prints."""
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
    try:
        assert process.stdout is not None
        line = process.stdout.readline()
        assert line.startswith("Runs: http://127.0.0.1:"), line
        yield line.removeprefix("Runs: ").strip()
    finally:
        process.send_signal(2)  # Ctrl-C
        assert process.wait(60) == 0


def open_run(browser: "Chrome", name: str) -> None:
    from selenium.webdriver.common.by import By

    link = wait(browser, lambda page: page.find_elements(By.LINK_TEXT, name), f"a link '{name}'")
    browser.get(link[0].get_attribute("href"))


@pytest.mark.slow
def test_runs_numbers_and_images_are_seen_in_mlflow(
    shown: ShownRuns, browser: "Chrome", screenshots: Path | None
) -> None:
    with served(shown.work) as address:
        browser.get(address)
        has_words(browser, "sweep of ", *shown.names, "add", "5cm5deg", "iou50")
        close_assistant(browser)
        take_picture(browser, screenshots, "mlflow_runs")

        address_of_list = browser.current_url
        open_run(browser, "sweep of " + shown.key)
        has_words(browser, "best by ADD(-S)", "sweep/add")
        take_picture(browser, screenshots, "mlflow_sweep")
        see_image(browser, "figure sweep")
        take_picture(browser, screenshots, "mlflow_figure")

        browser.get(address_of_list)
        open_run(browser, shown.names[0])
        has_words(browser, "targets have a right pose", "add_by_object")
        assert "best by" not in text_of(browser)
        see_image(browser, "panels of scene 0")
        take_picture(browser, screenshots, "mlflow_images")
        assert errors(browser) == []


def close_assistant(browser: "Chrome") -> None:
    """Close the panel that MLflow opens beside its pages, for more room."""
    from selenium.webdriver.common.by import By

    heading = "//*[contains(text(), 'MLflow Assistant')]/following::button[last()]"
    named = "//button[contains(@aria-label, 'lose')]"
    for each in browser.find_elements(By.XPATH, named) or browser.find_elements(By.XPATH, heading):
        if each.is_displayed():
            each.click()
            return


def see_image(browser: "Chrome", title: str) -> None:
    """Open the charts of the run that is shown, and find an image of that name that has loaded."""
    from selenium.webdriver.common.by import By

    charts = browser.current_url.partition("?")[0] + "/model-metrics"
    browser.get(f"{charts}?workflowType=machine_learning")
    close_assistant(browser)
    # MLflow puts images into the last section, which is closed at first.
    section = "//*[normalize-space(text())='Model metrics'][not(ancestor::*[@role='tablist'])]"
    last = wait(browser, lambda page: page.find_elements(By.XPATH, section), "the last section")
    browser.execute_script("arguments[0].scrollIntoView({block: 'center'})", last[-1])
    last[-1].click()
    wait(
        browser,
        lambda page: page.find_elements(By.XPATH, f"//*[contains(text(), '{title}')]"),
        title,
    )
    place = browser.find_elements(By.XPATH, f"//*[contains(text(), '{title}')]")[-1]
    browser.execute_script("arguments[0].scrollIntoView({block: 'start'})", place)

    def loaded(page: "Chrome") -> bool:
        images = page.find_elements(By.CSS_SELECTOR, "img")
        return any(int(each.get_property("naturalWidth") or 0) >= 100 for each in images)

    wait(browser, loaded, f"an image of '{title}'")
