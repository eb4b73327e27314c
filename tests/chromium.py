"""Pages as a reader sees them: headless Chromium, driven by selenium.

A test takes the fixture `browser` of conftest.py, which is skipped where Chromium is not installed:

    page = browser.open(ROOT / "results/paper/paper.html")
    assert page.errors == [] and page.elsewhere == []
    browser.screenshot("page.png")

Nothing gets out: Chromium resolves no name but localhost. What a page asks for elsewhere is noted.
"""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

PROGRAMS = ("chromium", "chromedriver")
FLAGS = (
    "--headless",
    "--no-sandbox",
    "--use-angle=swiftshader",  # WebGL by the processor
    "--enable-unsafe-swiftshader",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--no-proxy-server",
    "--host-resolver-rules=MAP * ~NOTFOUND , EXCLUDE localhost",
)
WIDE = (1280, 900)
AT_MOST = 60
"""Seconds for a page to load."""
SOON = 10
"""Seconds for a page to show something."""


@dataclass(frozen=True)
class Page:
    """What was seen while a page was loaded: errors on its console, and the URLs that it asked for."""

    title: str
    errors: list[str]
    requested: list[str]

    @property
    def elsewhere(self) -> list[str]:
        """The requests that leave this machine."""
        return [url for url in self.requested if not _is_here(url)]


def _is_here(url: str) -> bool:
    address = urlsplit(url)
    return address.scheme in ("file", "data", "blob") or address.hostname == "localhost"


def missing() -> str:
    """Why there is no browser here, or nothing."""
    absent = [name for name in PROGRAMS if not shutil.which(name)]
    return f"not in PATH: {', '.join(absent)} (Debian: chromium and chromium-driver)" if absent else ""


@contextmanager
def running(folder: Path) -> Iterator[Browser]:
    """A browser that keeps its files in an empty folder."""
    from selenium import webdriver

    chromium, driver = map(shutil.which, PROGRAMS)
    options = webdriver.ChromeOptions()
    options.binary_location = str(chromium)
    for flag in (*FLAGS, f"--user-data-dir={folder}"):
        options.add_argument(flag)
    options.set_capability("goog:loggingPrefs", {"browser": "ALL", "performance": "ALL"})
    started = webdriver.Chrome(options, webdriver.ChromeService(driver))
    try:
        started.set_page_load_timeout(AT_MOST)
        yield Browser(started)
    finally:
        started.quit()


class Browser:
    def __init__(self, driver: Any) -> None:
        self.driver = driver

    def open(self, path: str | os.PathLike[str], size: tuple[int, int] = WIDE, query: str = "") -> Page:
        """Loads a file in a window of that width and height in pixels; a `query` begins with a ?."""
        shape = {"width": size[0], "height": size[1], "deviceScaleFactor": 1, "mobile": False}
        self.driver.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", shape)
        self.driver.get("about:blank")
        self._log("browser"), self._log("performance")
        self.driver.get(Path(path).resolve().as_uri() + query)
        errors = [entry["message"] for entry in self._log("browser") if entry["level"] == "SEVERE"]
        events = [json.loads(entry["message"])["message"] for entry in self._log("performance")]
        sent = [event["params"] for event in events if event["method"] == "Network.requestWillBeSent"]
        return Page(self.driver.title, errors, [item["request"]["url"] for item in sent])

    def _log(self, name: str) -> list[dict[str, Any]]:
        """What came in since it was last asked for."""
        return list(self.driver.get_log(name))

    def heights(self, selector: str) -> list[float]:
        """Of the elements of the page that is open, in pixels."""
        script = (
            "return [...document.querySelectorAll(arguments[0])].map(e => e.getBoundingClientRect().height)"
        )
        return list(self.driver.execute_script(script, selector))

    def shows(self, selector: str, text: str) -> bool:
        """Whether an element of the page that is open shows a text, at once or soon."""
        from selenium.common.exceptions import TimeoutException
        from selenium.webdriver.support import expected_conditions, wait

        condition = expected_conditions.text_to_be_present_in_element(("css selector", selector), text)
        try:
            return bool(wait.WebDriverWait(self.driver, SOON).until(condition))
        except TimeoutException:
            return False

    def overflow(self) -> float:
        """Pixels by which the page that is open is wider than its window."""
        script = "const e = document.documentElement; return e.scrollWidth - e.clientWidth"
        return float(self.driver.execute_script(script))

    def screenshot(self, path: str | os.PathLike[str]) -> None:
        """A picture (PNG) of the window."""
        Path(path).write_bytes(self.driver.get_screenshot_as_png())
