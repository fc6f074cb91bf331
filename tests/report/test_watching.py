"""The page of `sprl-bench watch` in a real browser, while a real suite runs."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from browsers import chromium, needs_chromium, picture, quiet_page

pytestmark = needs_chromium
ADDRESS = re.compile(r"http://127\.0\.0\.1:\d+/")
PATIENCE_MS = 120_000  # on a busy machine


def command(*words: object) -> list[str]:
    return [sys.executable, "-m", "sprl_bench", *map(str, words)]


@pytest.fixture
def suite(tmp_path: Path) -> Iterator[Path]:
    """A suite that runs, two seeds of PPO one after the other, until the test ends."""
    words = ("--suite", "smoke", "--agents", "ppo", "--seeds", 2, "--workers", 1, "--budget", 400_000)
    with (tmp_path / "output.txt").open("w") as output:
        running = subprocess.Popen(
            command("run", *words, "--out", tmp_path / "runs"), stdout=output, stderr=output, start_new_session=True
        )
        yield tmp_path / "runs"
        os.killpg(running.pid, signal.SIGTERM)
        running.wait(timeout=60)


@pytest.fixture
def address(suite: Path) -> Iterator[str]:
    """The address of a server that watches it."""
    while not any(suite.rglob("metrics.jsonl")):
        time.sleep(0.1)
    words = command("watch", suite, "--port", 0, "--every", 1)
    with subprocess.Popen(words, stderr=subprocess.PIPE, text=True) as server:
        assert server.stderr is not None
        found = ADDRESS.search(server.stderr.readline())
        assert found is not None
        yield found[0]
        server.send_signal(signal.SIGINT)
        assert server.wait(timeout=30) == 0


def test_a_running_suite_is_watched(address: str) -> None:
    with chromium() as browser, quiet_page(browser, "desktop", offline=False) as page:
        page.goto(address)
        steps = page.locator("td.running + td")
        page.wait_for_selector("td.running", timeout=PATIENCE_MS)
        page.locator("[data-kind=metric]").first.scroll_into_view_if_needed()
        page.wait_for_selector("[data-kind=metric] svg.marks", timeout=PATIENCE_MS)
        first, curve = steps.inner_text(), curve_of(page)
        until(page, lambda: page.locator("#live").inner_text() == "Live.")
        until(page, lambda: not steps.count() or steps.first.inner_text() != first)
        until(page, lambda: curve_of(page) not in ("", curve))
        assert re.search(r"\d+\s% of all environment steps", page.locator("#progress-title + p").inner_text())
        assert float(page.locator("progress").get_attribute("value")) > 0
        assert len(picture(page, "watch")) > 10_000


def until(page: Any, condition: Callable[[], bool]) -> None:
    """Wait until something is so; the policy of the page lets Playwright evaluate no expression again and again."""
    for _ in range(PATIENCE_MS // 100):
        if condition():
            return
        page.wait_for_timeout(100)
    raise TimeoutError


def curve_of(page: Any) -> str:
    """Return the path of the first curve; nothing while it is drawn anew."""
    paths = "paths => paths.length ? paths[0].getAttribute('d') : ''"
    found: str = page.locator("[data-kind=metric] .mark-line path").evaluate_all(paths)
    return found
