"""MLflow as README says to open it, in a real browser: runs, columns, numbers, images."""

from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from page import ShownRuns, errors, has_words, take_picture, wait

from served_ui import served_ui

if TYPE_CHECKING:
    from selenium.webdriver import Chrome

COLUMNS = ["add", "targets", "frames", "ms", "5cm5deg", "iou50"]


@pytest.mark.slow
def test_runs_numbers_and_images_are_seen_in_mlflow(
    shown: ShownRuns, browser: "Chrome", screenshots: Path | None
) -> None:
    sweep, child = f"sweep of {shown.key}", shown.names[0]
    with served_ui(shown.work) as address:
        browser.get(address.partition("#")[0])
        choose_menu(browser)
        browser.get(address)
        has_words(browser, sweep)
        wait(browser, lambda page: metric_columns(page) == COLUMNS, "the headline metrics first")
        expand(browser, sweep, shown.names)
        assert float(cell(browser, child, "add")) == pytest.approx(shown.recalls[0], abs=0.002)
        take_picture(browser, screenshots, "mlflow_runs")

        open_run(browser, sweep)
        has_words(browser, f"{len(shown.names)} of {len(shown.names)} runs finished", "best by ADD")
        assert all(value in table(browser) for value in shown.values)
        unfold(browser)
        take_picture(browser, screenshots, "mlflow_sweep")
        see_image(browser, "figures/sweep")
        take_picture(browser, screenshots, "mlflow_figures")

        browser.get(address)
        has_words(browser, sweep)
        expand(browser, sweep, shown.names)
        open_run(browser, child)
        has_words(browser, "targets have a right pose", "targets")
        see_image(browser, "Pictures/poses in scene 0")
        take_picture(browser, screenshots, "mlflow_pictures")
        assert errors(browser) == []


def click(browser: "Chrome", path: str, what: str) -> None:
    """Click on what has been found by XPath, as soon as it can be."""
    from selenium.common.exceptions import ElementClickInterceptedException
    from selenium.webdriver.common.by import By

    def done(page: "Chrome") -> bool:
        found = [
            element for element in page.find_elements(By.XPATH, path) if element.is_displayed()
        ]
        try:
            found[0].click()
        except (ElementClickInterceptedException, IndexError):
            return False
        return True

    wait(browser, done, what)


def choose_menu(browser: "Chrome") -> None:
    """Choose MLflow's menu for training; close the assistant beside its pages, for more room."""
    click(browser, "//*[text()='Model training']", "the menu for training")
    click(browser, "//button[@aria-label='Close']", "the assistant's button")


def metric_columns(browser: "Chrome") -> list[str]:
    """Headings of the columns of metrics, from left to right."""
    words = """
        const heads = [...document.querySelectorAll(".ag-header-cell[col-id^='metrics.']")];
        const left = head => head.getBoundingClientRect().x;
        return heads.sort((a, b) => left(a) - left(b)).map(head => head.innerText.trim());
    """
    return [str(text) for text in browser.execute_script(words)]


def expand(browser: "Chrome", sweep: str, runs: tuple[str, ...]) -> None:
    """Show the runs of a sweep, whose row is closed at first."""
    click(browser, f"//div[@role='gridcell'][.//a[.='{sweep}']]//button", f"'{sweep}' to expand")
    has_words(browser, *runs)


def cell(browser: "Chrome", run: str, metric: str) -> str:
    """What stands in a run's column of a metric; rows are in two halves."""
    words = """
        const links = [...document.querySelectorAll(".ag-row a")];
        const row = links.find(link => link.innerText == arguments[0]).closest(".ag-row");
        const other = `.ag-row[row-index="${row.getAttribute("row-index")}"]`;
        const cells = [...document.querySelectorAll(`${other} .ag-cell`)];
        const name = "metrics.`" + arguments[1] + "`";
        return cells.find(element => element.getAttribute("col-id") == name).innerText;
    """
    return str(wait(browser, lambda page: page.execute_script(words, run, metric), metric))


def open_run(browser: "Chrome", name: str) -> None:
    click(browser, f"//div[@role='gridcell']//a[.='{name}']", f"a link '{name}'")


def table(browser: "Chrome") -> str:
    """The words of the table in a run's description."""
    return str(browser.execute_script("return document.querySelector('table').innerText"))


def unfold(browser: "Chrome") -> None:
    """Show all of the description, which MLflow folds if it is long."""
    from selenium.webdriver.common.by import By

    for element in browser.find_elements(By.XPATH, "//*[text()='Show more']"):
        element.click()


def see_image(browser: "Chrome", title: str) -> None:
    """Open the charts of the run that is shown, and wait for the image of that title."""
    from selenium.webdriver.common.by import By

    click(browser, "//*[@role='tab' or self::a][.='Model metrics']", "the charts' tab")
    image = f"//*[contains(text(), '{title}')]/following::img[1]"
    wait(browser, lambda page: page.find_elements(By.XPATH, image), title)
    place = browser.find_element(By.XPATH, image)
    browser.execute_script("arguments[0].scrollIntoView({block: 'center'})", place)

    def loaded(page: "Chrome") -> bool:
        return int(page.find_element(By.XPATH, image).get_property("naturalWidth") or 0) > 100

    wait(browser, loaded, f"an image of '{title}'")
