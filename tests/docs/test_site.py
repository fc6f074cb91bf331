"""The site: built from the repository, and its pages in a real browser without a network."""

from __future__ import annotations

import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import yaml
from browsers import SCREENS, WIDER_THAN_THE_SCREEN, chromium, needs_chromium, picture, quiet_page, serious_faults
from pages import ROOT, text_of

pytest.importorskip("sphinx", reason="sphinx is not installed")
SITE = ROOT / "docs" / "site"
FAMILIES = ("grids", "fetch", "mazes", "atari")
FILMS = sorted((ROOT / "docs" / "films").glob("*.gif"))


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The site, built as `make docs` builds it: with a warning, it fails."""
    target = tmp_path_factory.mktemp("site")
    built = subprocess.run([sys.executable, SITE / "build.py", target], check=False, capture_output=True, text=True)
    assert built.returncode == 0, built.stderr
    return target


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    with chromium() as started:
        yield started


@needs_chromium
@pytest.mark.parametrize("screen", SCREENS)
@pytest.mark.parametrize("name", ["index", "generated/grids"])
def test_a_page_is_sound(browser: Any, site: Path, name: str, screen: str) -> None:
    with quiet_page(browser, screen) as page:
        page.goto((site / f"{name}.html").as_uri())
        pictures = page.locator(".gallery img")
        assert pictures.count() >= 4
        widths = pictures.evaluate_all("images => images.map(image => image.complete && image.naturalWidth)")
        assert all(width >= 100 for width in widths)
        assert all(len(text) > 20 for text in pictures.evaluate_all("images => images.map(image => image.alt)"))
        assert page.locator("main img:not([alt]), article img[alt='']").count() == 0
        assert page.evaluate(WIDER_THAN_THE_SCREEN, "article *:not(pre *, table *, code *)") == []
        assert serious_faults(page) == []
        assert len(picture(page, f"site-{name.replace('/', '-')}")) > 50_000


@needs_chromium
@pytest.mark.parametrize("screen", SCREENS)
def test_a_wide_table_breaks_code_at_its_joints_and_has_a_scroll_bar_on_a_phone(
    browser: Any, site: Path, screen: str
) -> None:
    with quiet_page(browser, screen) as page:
        page.goto((site / "SECURITY.html").as_uri())
        table = page.locator(".table-wrapper")
        width, visible, bar = table.evaluate("e => [e.scrollWidth, e.clientWidth, e.offsetHeight - e.clientHeight]")
        assert (width > visible) == (bar >= 10) == (screen == "phone")
        assert width < 600 or screen == "desktop"
        picture(page, "site-security")


@needs_chromium
def test_the_results_hold_the_report_of_the_board(browser: Any, site: Path) -> None:
    with quiet_page(browser, "desktop") as page:
        page.goto((site / "docs" / "results.html").as_uri())
        frame = page.frame_locator("iframe.report")
        page.locator("iframe.report").scroll_into_view_if_needed()
        frame.locator("body[data-charts=drawn]").wait_for(timeout=60_000)
        assert "gt-grid" in frame.locator("#scores-0 tbody").inner_text()
        assert "grid-7x7" in page.locator("iframe.report").get_attribute("title")
        picture(page, "site-results")


@needs_chromium
@pytest.mark.parametrize("screen", SCREENS)
def test_the_report_follows_the_theme_that_the_site_shows(browser: Any, site: Path, screen: str) -> None:
    with quiet_page(browser, screen) as page:
        page.add_init_script("console.log = () => {}")  # the theme logs its button
        page.goto((site / "docs" / "results.html").as_uri())
        for visit in ("fresh", "again"):
            report = page.frame_locator("iframe.report")
            page.locator("iframe.report").scroll_into_view_if_needed()
            report.locator("body[data-charts=drawn]").wait_for(timeout=60_000)
            for _ in range(4 if visit == "fresh" else 1):  # the second visit begins with the choice of the first
                theme = page.locator("body").get_attribute("data-theme")
                report.locator(f"html[data-theme={theme}]").wait_for(timeout=10_000)
                dark = theme == "dark" or (theme == "auto" and SCREENS[screen][2] == "dark")
                paper = report.locator("body").evaluate("body => getComputedStyle(body).backgroundColor")
                assert paper == ("rgb(20, 23, 26)" if dark else "rgb(255, 255, 255)")
                page.evaluate("scrollTo(0, 0)")
                page.locator(".theme-toggle:visible").first.click()
            page.reload()


def test_every_family_has_a_page_with_films_and_docstrings(site: Path) -> None:
    for name in FAMILIES:
        text = (site / "generated" / f"{name}.html").read_text()
        assert "<figcaption>" in text
        for part in ("Description", "Action Space", "Rewards", "Version history"):
            assert part in text, (name, part)


def test_every_film_is_shown_and_small() -> None:
    table = text_of("docs/site/films.py")
    assert {film.stem for film in FILMS} == set(re.findall(r'Film\(\s*"([\w-]+)"', table))
    assert max(film.stat().st_size for film in FILMS) < 300_000
    assert sum(film.stat().st_size for film in FILMS) < 2_500_000


def test_each_part_of_the_site_is_there(site: Path) -> None:
    for name in ("boards", "board-grid-7x7", "citation", "commands", "python", *FAMILIES):
        assert (site / "generated" / f"{name}.html").exists(), name
    commands = (site / "generated" / "commands.html").read_text()
    assert all(f"sprl-bench {name}</h2>" in re.sub(r"<a [^>]*>[^<]*</a>", "", commands) for name in ("run", "report"))
    assert (site / "boards" / "grid-7x7.html").read_text().startswith("<!DOCTYPE html>")


def test_the_paper_is_cited_as_in_the_readme(site: Path) -> None:
    about = yaml.safe_load(text_of("CITATION.cff"))
    shown = re.sub(r"<[^>]+>", "", (site / "generated" / "citation.html").read_text())
    readme = text_of("README.md")
    for entry in ("@inproceedings{sohn2021shortest,", "@software{sprl_bench,"):
        assert entry in shown
        assert entry in readme
    for line in re.findall(r"^  (?:title|author|booktitle) +.*$", readme, re.MULTILINE):
        assert line.split("= ")[1].rstrip(",") in shown
    assert about["version"] in shown


def test_no_page_of_the_site_asks_the_network_for_anything(site: Path) -> None:
    for page in site.rglob("*.html"):
        loaded = re.findall(r"<(?:script|img|iframe|link)[^>]+(?:src|href)=\"(https?:[^\"]+)\"", page.read_text())
        assert not loaded, page
