"""The report in a real browser, opened from disk without a network."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from browsers import SCREENS, chromium, needs_chromium, picture, quiet_page, serious_faults

from sprl_bench.records import RunRecord
from sprl_bench.report import Progress, of_runs, write_report

HOSTILE = ("a & b 'c'", "אבג דהו", "m" * 150)
ATTACK = "</script><script>document.title='owned'</script><img src=x onerror=\"document.title='owned'\">"
MakeRecord = Callable[..., RunRecord]

KINDS = ("curve", "interval", "improvement", "profile", "metric")

pytestmark = needs_chromium


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    with chromium() as started:
        yield started


@pytest.fixture(scope="module")
def report(make_record: MakeRecord, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Five agents, one of them privileged, three with hostile names, on two tasks."""
    agents = {"ppo": 0.3, "gt-grid": 0.8, **{name: 0.1 * n for n, name in enumerate(HOSTILE, 4)}}
    records = [
        make_record(
            agent,
            task,
            seed,
            suite="grid-7x7",
            curve=np.linspace(0, level + 0.02 * seed, 100),
            privileged=agent == "gt-grid",
            hyperparameters={ATTACK: ATTACK},
            git_commit=ATTACK,
        )
        for agent, level in agents.items()
        for task in ("FourRooms-7x7", "KeyDoors-7x7")
        for seed in range(3)
    ]
    steps = [{"env_steps": n, "wall_time_s": 1.0, "return": 0.1, ATTACK: n / 7} for n in range(5_000, 500_000, 5_000)]
    failed = Progress(make_record("ppo", seed=9, suite="grid-7x7").spec, "failed", 10, None, ATTACK)
    source = of_runs(ATTACK, records, [failed], logged=[(records[0].spec, steps)], notes=[ATTACK])
    path = tmp_path_factory.mktemp("report") / "report.html"
    write_report(source, path)
    return path


@pytest.fixture(scope="module", params=SCREENS)
def page(request: pytest.FixtureRequest, browser: Any, report: Path) -> Iterator[Any]:
    with quiet_page(browser, request.param) as opened:
        opened.goto(report.as_uri())
        drawn(opened)
        yield opened


def drawn(page: Any) -> None:
    page.wait_for_selector("body[data-charts=drawn]", timeout=60_000)


def chart_of(page: Any, kind: str) -> Any:
    """Return the first chart of a kind, scrolled to and drawn."""
    chart = page.locator(f"[data-kind={kind}]").first
    chart.evaluate("chart => chart.scrollIntoView({block: 'center'})")
    page.evaluate("new Promise(next => requestAnimationFrame(() => requestAnimationFrame(next)))")  # it is noticed
    drawn(page)
    return chart


def agents_in(page: Any) -> list[str]:
    names: list[str] = page.locator("#scores-0 tbody tr:visible th").all_inner_texts()
    return [name.removesuffix("‡").strip() for name in names]


def switch(page: Any, name: str) -> None:
    if not page.locator("#agents details").get_attribute("open") is not None:
        page.locator("#agents summary").first.click()
    page.get_by_label(name, exact=False).first.click()
    drawn(page)


def test_hostile_text_is_text(page: Any) -> None:
    assert "owned" not in page.title().replace(ATTACK, "")
    assert page.locator("h1").inner_text() == ATTACK
    assert set(HOSTILE) <= set(agents_in(page))
    assert page.locator("img").count() == 0
    assert page.locator(".warning").first.inner_text() == ATTACK


def test_the_page_is_no_wider_than_the_screen(page: Any) -> None:
    wide = "[...document.querySelectorAll('main > * > *, nav *, header *')]"
    wide += ".filter(element => element.getBoundingClientRect().right > innerWidth)"
    assert page.evaluate(f"{wide}.map(e => e.outerHTML.slice(0, 100))") == []
    assert page.evaluate("document.documentElement.scrollWidth <= innerWidth")


@pytest.mark.parametrize("screen", SCREENS)
def test_the_provenance_fits_a_desktop_and_has_a_scroll_bar_on_a_phone(
    browser: Any, make_record: MakeRecord, tmp_path: Path, screen: str
) -> None:
    hardware = {"cpu": "Intel(R) Xeon(R) Processor", "cores": 16, "memory_gib": 126.0}
    made = {"suite": "grid-7x7", "hardware": hardware, "wall_time_s": 3000.0, "git_commit": "4d57d2a5b7" * 4}
    write_report(of_runs("runs", [make_record("gt-grid@tuned", **made)], []), tmp_path / "report.html")
    with quiet_page(browser, screen) as page:
        page.goto((tmp_path / "report.html").as_uri())
        frame = page.get_by_label("Provenance")
        width, visible, bar = frame.evaluate("e => [e.scrollWidth, e.clientWidth, e.offsetHeight - e.clientHeight - 2]")
        assert (width > visible) == (bar >= 10) == (screen == "phone")


def test_a_chart_is_drawn_when_it_comes_into_view(page: Any) -> None:
    assert page.locator("[data-kind=metric] svg.marks").count() == 0
    for kind in KINDS:
        assert "ppo" in chart_of(page, kind).locator("[role=graphics-document]").get_attribute("aria-label")


def test_a_printed_page_shows_every_chart(browser: Any, report: Path) -> None:
    with quiet_page(browser, "desktop") as page:
        page.goto(report.as_uri())
        drawn(page)
        assert page.locator(".chart svg.marks").count() < page.locator(".chart").count()
        page.pdf()
        assert page.locator(".chart svg.marks").count() == page.locator(".chart").count() == 6


def test_headings_sort(page: Any) -> None:
    assert agents_in(page)[0] == "gt-grid †"
    head = page.locator("#scores-0 thead th", has_text="Mean AUC")
    assert head.get_attribute("aria-sort") == "descending"
    head.locator("button").focus()
    page.keyboard.press("Enter")
    assert head.get_attribute("aria-sort") == "ascending"
    assert agents_in(page)[0] == "ppo"
    assert page.locator("#scores-0 thead th[aria-sort=none]").count() == 7


def test_an_agent_is_switched_off_in_the_table_and_the_charts(page: Any) -> None:
    lines = chart_of(page, "curve").locator(".mark-line.layer_2_marks path, .layer_2_pathgroup path")
    before = lines.count()
    switch(page, "ppo")
    assert "ppo" not in agents_in(page)
    assert lines.count() * 5 == before * 4
    assert "ppo" not in chart_of(page, "curve").locator("[role=graphics-document]").get_attribute("aria-label")
    switch(page, "ppo")
    assert lines.count() == before


def test_charts_without_an_agent_say_so_and_take_no_room(page: Any) -> None:
    page.locator("#agents details").evaluate("agents => { agents.open = true; }")
    page.locator("[data-all=off]").click()
    for kind in KINDS:
        chart = chart_of(page, kind)
        assert "No agent that is shown" in chart.inner_text()
        assert chart.bounding_box()["height"] < 100
    page.locator("[data-all=on]").click()
    assert chart_of(page, "curve").locator("svg.marks").count() == 1


def test_the_dot_of_an_agent_is_beside_the_first_line_of_its_name(page: Any) -> None:
    top_of = "part => part.getClientRects()[0].top"
    for row in page.locator("#scores-0 tbody th").all():
        assert row.locator(".dot").evaluate(top_of) >= row.locator("bdi").evaluate(top_of)


def test_ticks_on_a_phone_are_apart(browser: Any, make_record: MakeRecord, tmp_path: Path) -> None:
    run = make_record(suite="grid-7x7", task_changes={"budget": 600_000})
    write_report(of_runs("runs", [run], []), tmp_path / "report.html")
    with quiet_page(browser, "phone") as page:
        page.set_viewport_size({"width": 405, "height": 844})  # 500k and 600k touch without overlapping
        page.goto((tmp_path / "report.html").as_uri())
        labels = chart_of(page, "curve").locator(".role-axis-label").first.locator("text:not([opacity='0'])")
        boxes = [label.bounding_box() for label in labels.all()]
        assert len(boxes) > 1
        assert all(a["x"] + a["width"] + 3 < b["x"] for a, b in pairwise(boxes))


def test_one_switch_leaves_ordinary_agents_only(page: Any) -> None:
    reference = page.locator("[data-choice=reference]").first
    origins = page.locator("section:has(#origins-title) tr[data-agent] th:visible")
    reference.select_option(label="gt-grid †")
    switch(page, "Ordinary agents only")
    assert "gt-grid †" not in agents_in(page)
    assert "ppo" in agents_in(page)
    assert "gt-grid †" not in origins.all_inner_texts()
    assert reference.evaluate("select => select.selectedOptions[0].text") != "gt-grid †"
    switch(page, "Ordinary agents only")
    assert "gt-grid †" in agents_in(page)
    assert "gt-grid †" in origins.all_inner_texts()


def test_a_pointer_on_a_curve_lights_its_agent_up_everywhere(page: Any) -> None:
    page.locator("#agents details").evaluate("agents => { agents.open = innerWidth > 768; }")  # it covers a phone
    chart = chart_of(page, "curve").locator("svg.marks")
    box = chart.bounding_box()
    page.mouse.move(box["x"] + box["width"] * 0.95, box["y"] + box["height"] * 0.2)
    page.mouse.move(box["x"] + box["width"] * 0.9, box["y"] + box["height"] * 0.22)
    page.wait_for_selector("tr.lit", state="attached")
    assert page.locator("#scores-0 tr.lit th").inner_text().strip() == "gt-grid †"
    assert page.locator("#vg-tooltip-element").inner_text().startswith("Agent")
    assert page.locator("[data-kind=curve] >> nth=1").locator("*").count() * 3 < chart.locator("*").count()
    faint = page.locator("[data-kind=curve] >> nth=1").locator("path[opacity='0.12']")
    page.wait_for_function("document.querySelectorAll('[data-kind=curve] path[opacity=\"0.12\"]').length > 1")
    assert faint.count() > 0


def test_scores_and_references_can_be_chosen(page: Any) -> None:
    page.locator("[data-choice=measure]").select_option("final")
    assert "final" in chart_of(page, "interval").locator("[role=graphics-document]").get_attribute("aria-label")
    page.locator("[data-choice=reference]").select_option(label="ppo")
    assert "over ppo" in chart_of(page, "improvement").locator("[role=graphics-document]").get_attribute("aria-label")


def test_seeds_are_listed_and_downloaded(page: Any, tmp_path: Path) -> None:
    page.locator("#seeds summary").click()
    page.wait_for_selector("#seeds tbody tr")
    assert page.locator("#seeds tbody tr").count() == 30
    with page.expect_download() as caught:
        page.locator("[data-download=seeds]").click()
    caught.value.save_as(tmp_path / "seeds.csv")
    lines = (tmp_path / "seeds.csv").read_text().splitlines()
    assert lines[0].startswith("suite,task,agent,seed,auc")
    assert len(lines) == 31


def test_axe_finds_no_serious_fault(page: Any) -> None:
    assert serious_faults(page) == []


def test_charts_mark_privileged_agents_and_explain_the_mark(page: Any) -> None:
    assert "gt-grid †" in chart_of(page, "interval").inner_html()
    for kind in ("interval", "improvement", "profile"):
        caption = page.locator("figure", has=page.locator(f"[data-kind={kind}]")).locator("figcaption")
        assert "† privileged" in caption.inner_text()


def test_paper_has_the_legend_but_no_hints_for_the_screen(page: Any) -> None:
    page.emulate_media(media="print")
    shown = page.locator("body").inner_text()
    assert "Point at a curve" not in shown
    assert "The buttons sort" not in shown
    assert not page.locator("[data-download=seeds]").is_visible()
    assert page.locator("#agents li svg").first.is_visible()
    taken = picture(page, "report-print")
    page.emulate_media(media="screen")
    assert "Point at a curve" in page.locator("body").inner_text()
    assert len(taken) > 50_000


def test_pictures_of_the_page_are_kept(page: Any) -> None:
    assert len(picture(page, "report")) > 50_000
