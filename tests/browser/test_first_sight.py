"""What a stranger sees first: README, the documentation's start, a report by phone and at night."""

from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from markdown_it import MarkdownIt
from page import ShownRuns, errors, is_too_wide, seen_by, take_picture

if TYPE_CHECKING:
    from selenium.webdriver import Chrome

pytestmark = pytest.mark.slow
ROOT = Path(__file__).parents[2]
HEAD = """<!doctype html><meta name=viewport content="width=device-width"><style>
body {max-width: 900px; margin: auto; font-family: sans-serif} img {max-width: 100%}
pre {overflow: auto} table {display: block; overflow: auto}</style>"""
PHONE, DESK = (390, 844), (1440, 900)


@pytest.mark.parametrize("size", [PHONE, DESK], ids=["phone", "desk"])
def test_readme_and_its_pictures_fit(
    browser: "Chrome", screenshots: Path | None, tmp_path: Path, size: tuple[int, int]
) -> None:
    text = MarkdownIt().enable("table").render((ROOT / "README.md").read_text())
    page = tmp_path / "readme.html"
    page.write_text(f"{HEAD}<base href='{ROOT.as_uri()}/'>{text}")
    seen_by(browser, *size)
    browser.get(page.as_uri())
    assert browser.execute_script(
        "return [...document.images].every(each => each.complete && each.naturalWidth > 300)"
    )
    take_picture(browser, screenshots, f"readme_{size[0]}")
    assert errors(browser) == []


@pytest.mark.parametrize("dark", [False, True], ids=["light", "dark"])
@pytest.mark.parametrize("size", [PHONE, DESK], ids=["phone", "desk"])
def test_a_report_fits_a_phone_and_goes_dark(
    shown: ShownRuns, browser: "Chrome", screenshots: Path | None, size: tuple[int, int], dark: bool
) -> None:
    seen_by(browser, *size, dark)
    browser.get((shown.run / "report.html").as_uri())
    color = browser.execute_script("return getComputedStyle(document.body).backgroundColor")
    brightness = sum(int(part) for part in color.strip("rgba()").split(",")[:3])
    assert (brightness < 200) == dark
    assert not is_too_wide(browser)
    take_picture(browser, screenshots, f"report_{size[0]}{'_dark' * dark}")
    assert errors(browser) == []


@pytest.mark.parametrize("size", [PHONE, DESK], ids=["phone", "desk"])
def test_the_documentation_starts(
    browser: "Chrome", screenshots: Path | None, size: tuple[int, int]
) -> None:
    start = ROOT / "build" / "docs" / "index.html"
    if not start.is_file():
        pytest.skip("no documentation is built here: make docs")
    seen_by(browser, *size, dark=size == PHONE)
    for name, page in (("docs", start), ("gallery", start.parent / "notebooks" / "index.html")):
        browser.get(page.as_uri())
        assert not is_too_wide(browser)
        take_picture(browser, screenshots, f"{name}_{size[0]}")
