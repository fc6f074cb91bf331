"""A real browser for tests of pages: what it complains of, what axe-core finds, and pictures that are kept."""

from __future__ import annotations

import contextlib
import os
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

CHROMIUM = shutil.which("chromium")
AXE = Path(os.environ.get("AXE", "axe.min.js"))
FLAGS = ["--no-sandbox", "--disable-gpu", "--disable-background-networking"]
SCREENS = {"desktop": (1280, 900, "light"), "phone": (390, 844, "dark")}

needs_chromium = pytest.mark.skipif(not CHROMIUM, reason="chromium is not installed")
WIDER_THAN_THE_SCREEN = (
    "(parts) => [...document.querySelectorAll(parts)]"
    ".filter(part => part.getBoundingClientRect().right > innerWidth + 1).map(part => part.outerHTML.slice(0, 100))"
)


@contextlib.contextmanager
def chromium() -> Iterator[Any]:
    """Start Debian's Chromium under Playwright, with scroll bars; skip the test where that is not installed."""
    playwright = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
    with playwright.sync_playwright() as driver:
        started = driver.chromium.launch(
            executable_path=CHROMIUM, args=FLAGS, ignore_default_args=["--hide-scrollbars"]
        )
        yield started
        started.close()


@contextlib.contextmanager
def quiet_page(browser: Any, screen: str, *, offline: bool = True) -> Iterator[Any]:
    """Open an empty page, and check at the end that nothing went to the console, and nothing to the network if offline.

    Args:
        browser: A started browser.
        screen: One of `SCREENS`.
        offline: Whether there is no network.
    """
    width, height, scheme = SCREENS[screen]
    context = browser.new_context(
        viewport={"width": width, "height": height}, color_scheme=scheme, offline=offline, accept_downloads=True
    )
    page = context.new_page()
    complaints: list[str] = []
    page.on("console", lambda message: complaints.append(message.text))
    page.on("pageerror", lambda error: complaints.append(str(error)))
    if offline:
        page.on("request", lambda sent: complaints.append(sent.url) if sent.url.startswith("http") else None)
    yield page
    context.close()
    assert not complaints, complaints


def serious_faults(page: Any) -> list[tuple[str, list[str]]]:
    """Return the serious faults that axe-core finds, each with some of its elements; skip where it is not there."""
    if not AXE.exists():
        pytest.skip("axe-core is not there; AXE must name its axe.min.js")
    page.evaluate(AXE.read_text(encoding="utf-8"))
    return [
        (fault["id"], [node["html"][:200] for node in fault["nodes"][:3]])
        for fault in page.evaluate("axe.run({preload: false})")["violations"]
        if fault["impact"] in ("serious", "critical")
    ]


def picture(page: Any, name: str) -> bytes:
    """Take a picture of the whole page, and keep it in the folder that SCREENSHOTS names, if any."""
    folder = os.environ.get("SCREENSHOTS")
    path = Path(folder, f"{name}-{page.viewport_size['width']}.png") if folder else None
    taken: bytes = page.screenshot(path=path, full_page=True)
    return taken
