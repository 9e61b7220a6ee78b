"""report.html in a real browser: sorting, filtering, opening a target, turning the 3D view."""

from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from page import ShownRuns, errors, take_picture, wait

if TYPE_CHECKING:
    from selenium.webdriver import Chrome


def column(browser: "Chrome", number: int) -> list[str]:
    rows = "[...document.querySelectorAll('#list tbody tr')]"
    words = f"return {rows}.map(row => row.cells[{number}].textContent)"
    return [str(text) for text in browser.execute_script(words)]


@pytest.mark.slow
def test_targets_are_sorted_filtered_opened_and_turned(
    shown: ShownRuns, browser: "Chrome", screenshots: Path | None
) -> None:
    from selenium.webdriver.common.action_chains import ActionChains
    from selenium.webdriver.common.by import By

    browser.get((shown.run / "report.html").as_uri())
    heads = browser.find_elements(By.CSS_SELECTOR, "#list th")
    assert len(column(browser, 0)) > 1
    take_picture(browser, screenshots, "report")

    heads[2].click()
    up = column(browser, 2)
    assert up == sorted(up)
    heads[2].click()
    assert column(browser, 2) == sorted(up, reverse=True)

    browser.find_element(By.ID, "filter").send_keys(up[0])
    filtered = column(browser, 2)
    assert set(filtered) == {up[0]} and len(filtered) == up.count(up[0])
    browser.find_element(By.ID, "filter").clear()
    browser.find_element(By.ID, "filter").send_keys(" ")
    wait(browser, lambda page: len(column(page, 2)) == len(up), "all targets again")

    row = browser.find_element(By.CSS_SELECTOR, "#list tr.seen")
    browser.execute_script("arguments[0].scrollIntoView({block: 'center'})", row)
    row.click()
    look = browser.find_element(By.ID, "look")
    assert look.is_displayed()
    picture = browser.find_element(By.ID, "picture")
    wait(browser, lambda page: int(picture.get_property("naturalWidth")) > 300, "a picture")

    canvas = browser.find_element(By.ID, "view")
    drawn = "return document.getElementById('view').toDataURL()"
    before = browser.execute_script(drawn)
    browser.execute_script("arguments[0].scrollIntoView({block: 'center'})", canvas)
    ActionChains(browser).drag_and_drop_by_offset(canvas, 90, 20).perform()
    assert browser.execute_script(drawn) != before
    take_picture(browser, screenshots, "report_target")
    assert errors(browser) == []


@pytest.mark.slow
def test_the_page_of_a_sweep_shows_all_arms(shown: ShownRuns, browser: "Chrome") -> None:
    browser.get((shown.sweep / "report.html").as_uri())
    words = str(browser.execute_script("return document.body.innerText"))
    assert all(value in words for value in shown.values)
    assert errors(browser) == []
