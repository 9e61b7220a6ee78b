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
    from selenium.webdriver.common.keys import Keys

    browser.get((shown.run / "report.html").as_uri())
    head = browser.find_element(By.XPATH, "//table[@id='list']//button[.='object']")
    assert len(column(browser, 0)) > 1
    take_picture(browser, screenshots, "report")

    head.send_keys(Keys.ENTER)
    up = column(browser, 2)
    assert up == sorted(up) and sorted_by(browser) == ["object", "ascending"]
    head.click()
    assert column(browser, 2) == sorted(up, reverse=True)
    assert sorted_by(browser) == ["object", "descending"]

    browser.find_element(By.ID, "filter").send_keys(up[0])
    filtered = column(browser, 2)
    assert set(filtered) == {up[0]} and len(filtered) == up.count(up[0])
    lines = table_as_csv(browser).splitlines()
    assert len(lines) == len(filtered) + 1 and all(up[0] in line for line in lines[1:])
    browser.find_element(By.ID, "filter").clear()
    browser.find_element(By.ID, "filter").send_keys(" ")
    wait(browser, lambda page: len(column(page, 2)) == len(up), "all targets again")

    row = browser.find_element(By.XPATH, "//tbody/tr[td[4]='▣']")
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

    opened = "return document.querySelector('#list [aria-current]').innerText"
    words = browser.execute_script(opened)
    head.click()
    assert browser.execute_script(opened) == words  # also after sorting
    address = str(browser.find_element(By.ID, "name").get_attribute("href"))
    browser.get("about:blank")
    browser.get(address)
    assert browser.execute_script(opened) == words
    assert errors(browser) == []


def sorted_by(browser: "Chrome") -> list[str]:
    """The only heading that is said to be sorted by, and which way."""
    words = "[...document.querySelectorAll('#list th:not([aria-sort=none])')]"
    found = browser.execute_script(f"return {words}.map(h => [h.innerText, h.ariaSort])")
    assert len(found) == 1
    return [str(text).split(" ")[0] for text in found[0]]


def table_as_csv(browser: "Chrome") -> str:
    """What the link below the filter downloads."""
    words = """
        const link = document.getElementById("csv"), done = arguments[0];
        link.addEventListener("click", event => event.preventDefault(), {once: true});
        URL.createObjectURL = blob => { blob.text().then(done); return "#"; };
        link.click();
    """
    return str(browser.execute_async_script(words))


@pytest.mark.slow
def test_frames_come_first_and_pictures_open_large(shown: ShownRuns, browser: "Chrome") -> None:
    from selenium.webdriver.common.action_chains import ActionChains
    from selenium.webdriver.common.by import By
    from selenium.webdriver.common.keys import Keys

    browser.get((shown.run / "report.html").as_uri())
    first = browser.find_element(By.CSS_SELECTOR, "main img")
    assert "with all poses" in str(first.get_attribute("alt"))
    first.click()
    large = browser.find_element(By.CSS_SELECTOR, "dialog img")
    assert large.is_displayed() and large.size["width"] > first.size["width"]
    large.click()
    assert not large.is_displayed()
    first.send_keys(Keys.ENTER)
    assert large.is_displayed()
    ActionChains(browser).send_keys(Keys.ESCAPE).perform()
    assert not large.is_displayed()


@pytest.mark.slow
def test_truth_and_estimate_lie_within_the_3d_view(shown: ShownRuns, browser: "Chrome") -> None:
    """Also where they are far apart, as of most misses."""
    far = "data.scenes.targets[name].estimate[3] += 900"
    page = (
        (shown.run / "report.html")
        .read_text()
        .replace(
            "  const at = id =>",
            f"  for (const name in data.scenes.targets) {{ {far}; }}\n  const at = id =>",
        )
    )
    moved = shown.run / "moved.html"
    moved.write_text(page)
    browser.get(moved.as_uri())
    browser.execute_script("document.getElementById('cloud').click()")
    words = """
        const view = document.getElementById("view"), {width, height} = view;
        const pixels = view.getContext("2d").getImageData(0, 0, width, height).data;
        const at = (x, y) => pixels[4 * (y * width + x) + 3] > 0;
        let inside = 0, edge = 0;
        for (let y = 0; y < height; y++) for (let x = 0; x < width; x++) if (at(x, y)) {
            inside += 1;
            edge += x === 0 || y === 0 || x === width - 1 || y === height - 1;
        }
        return [inside, edge];
    """
    inside, edge = browser.execute_script(words)
    moved.unlink()
    assert inside > 100 and edge == 0
