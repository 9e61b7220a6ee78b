"""What the browser tests look at, and do: wait, find by words, take pictures, read the console."""

import io
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from selenium.webdriver import Chrome

PATIENCE = 180  # s; a busy machine takes long for MLflow's pages
# MLflow's own: it asks for users that a server without accounts does not have, and Chromium's note
# that a size is told in the next frame.
KNOWN = ("ajax-api/2.0/mlflow/users/current", "ResizeObserver loop")
LARGEST = 150_000  # bytes of a picture in the documentation


@dataclass(frozen=True)
class ShownRuns:
    """A run and a sweep with their database; values, names and ADD(-S) recalls of its runs."""

    work: Path
    run: Path
    sweep: Path
    values: tuple[str, ...]
    names: tuple[str, ...]
    recalls: tuple[float, ...]
    key: str


def wait(browser: "Chrome", condition: Callable[["Chrome"], Any], what: str) -> Any:
    from selenium.common.exceptions import (
        JavascriptException,
        NoSuchElementException,
        StaleElementReferenceException,
    )
    from selenium.webdriver.support.ui import WebDriverWait

    ignored = [JavascriptException, NoSuchElementException, StaleElementReferenceException]
    return WebDriverWait(browser, PATIENCE, ignored_exceptions=ignored).until(condition, what)


def has_words(browser: "Chrome", *words: str) -> None:
    for word in words:
        wait(browser, lambda page, word=word: word in text_of(page), f"'{word}' on the page")


def text_of(browser: "Chrome") -> str:
    return str(browser.execute_script("return document.body.innerText"))


def errors(browser: "Chrome") -> list[str]:
    """Errors on the console since the last call."""
    found = browser.get_log("browser")
    severe = [entry["message"] for entry in found if entry["level"] == "SEVERE"]
    return [entry for entry in severe if not any(known in entry for known in KNOWN)]


def seen_by(browser: "Chrome", width: int, height: int, dark: bool = False) -> None:
    """Show pages from now on as on a screen of that size (px), perhaps in the dark."""
    size = {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": width < 600}
    browser.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", size)
    scheme = {"name": "prefers-color-scheme", "value": "dark" if dark else "light"}
    browser.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": [scheme]})


def is_too_wide(browser: "Chrome") -> bool:
    """Whether one would have to move the page sideways to read it."""
    root = "document.documentElement"
    return bool(browser.execute_script(f"return {root}.scrollWidth > {root}.clientWidth"))


def take_picture(browser: "Chrome", folder: Path | None, name: str) -> None:
    """Write a JPEG for the documentation, if a folder is given."""
    if folder is None:
        return
    from PIL import Image

    picture = Image.open(io.BytesIO(browser.get_screenshot_as_png())).convert("RGB")
    folder.mkdir(parents=True, exist_ok=True)
    for quality in range(88, 30, -6):
        picture.save(folder / f"{name}.jpg", quality=quality, optimize=True)
        if (folder / f"{name}.jpg").stat().st_size < LARGEST:
            break
