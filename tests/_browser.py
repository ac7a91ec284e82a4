"""A browser for the tests that open a page: skipped where it is absent, but in CI it must be there."""

import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

BROWSER = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
DRIVER = shutil.which("chromedriver")
AXE = Path(os.environ.get("AXE_CORE", "axe.min.js"))
needs_axe = pytest.mark.skipif(not AXE.is_file(), reason="AXE_CORE names no axe.min.js")
FLAGS = (
    "--no-sandbox",
    "--disable-gpu",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
)


def browser_is_there(*, driven: bool = True) -> None:
    """Skip the tests without a browser, or what drives it where they need that; in CI they fail."""
    if BROWSER is None or (driven and DRIVER is None):
        if os.environ.get("CI", "").lower() not in ("", "0", "false"):
            pytest.fail("chromium or chromedriver is absent although CI is set; install Debian's chromium-driver")
        pytest.skip("chromium and chromedriver are not on this machine")


@contextmanager
def started_browser(profile: Path, *flags: str, **preferences: object) -> Iterator:
    """A browser without a window that keeps what its pages log, with a new profile."""
    from selenium import webdriver

    options = webdriver.ChromeOptions()
    options.binary_location = BROWSER
    for flag in ("--headless=new", *FLAGS, *flags, f"--user-data-dir={profile}"):
        options.add_argument(flag)
    options.add_experimental_option("prefs", preferences)
    options.set_capability("goog:loggingPrefs", {"browser": "ALL"})
    driver = webdriver.Chrome(options=options, service=webdriver.ChromeService(DRIVER))
    try:
        yield driver
    finally:
        driver.quit()


def serious_faults(page) -> list[str]:
    """What axe finds serious in a page, its shadow roots included."""
    page.execute_script(AXE.read_text("utf-8"))
    found = page.execute_async_script("axe.run(document).then(arguments[arguments.length - 1])")
    return [fault["id"] for fault in found["violations"] if fault["impact"] in ("serious", "critical")]
