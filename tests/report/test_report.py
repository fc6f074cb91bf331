"""The report's content, what is refused, and the server of the live page."""

from __future__ import annotations

import html
import http.client
import json
import os
import re
import threading
from collections.abc import Callable, Iterator
from html.parser import HTMLParser
from http.server import ThreadingHTTPServer
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cli_calls import Capture, call, refused
from sprl_bench import scores
from sprl_bench.records import RunRecord, write
from sprl_bench.records.folder import lock
from sprl_bench.report import Progress, make_server, of_runs, render_report
from sprl_bench.report.document import embedded
from sprl_bench.report.series import metrics_of
from sprl_bench.tables import tabulate
from sprl_bench.tables.render import footnotes

MakeRecord = Callable[..., RunRecord]
WriteRuns = Callable[[list[RunRecord]], Path]


def page_of(records: list[RunRecord], **more: Any) -> str:
    progress = [Progress(one.spec, "finished", one.spec.task.budget) for one in records if one.status == "complete"]
    return render_report(of_runs("runs", records, [*progress, *more.pop("progress", ())], **more))


def data_of(page: str) -> dict[str, Any]:
    [text] = re.findall(r'<script type="application/json" id="data">(.*?)</script>', page, re.DOTALL)
    data: dict[str, Any] = json.loads(text)
    return data


class Text(HTMLParser):
    """Collects what a reader sees, and every address that a browser would load."""

    def __init__(self, page: str) -> None:
        super().__init__()
        self.words: list[str] = []
        self.loaded: list[str] = []
        self._hidden = False
        self.feed(page)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self._hidden = tag in ("script", "style")
        self.loaded += [value or "" for name, value in attrs if name in ("src", "srcset", "data", "action")]
        self.loaded += [dict(attrs).get("href") or "" for _ in [0] if tag == "link"]

    def handle_endtag(self, tag: str) -> None:
        self._hidden = False

    def handle_data(self, data: str) -> None:
        if not self._hidden:
            self.words.append(data)


def test_the_page_loads_nothing(grid_7x7: list[RunRecord]) -> None:
    page = page_of(grid_7x7)
    assert Text(page).loaded == []
    assert "connect-src 'none'" in html.unescape(page)
    assert "default-src 'none'" in html.unescape(page)


def test_every_note_of_the_table_is_in_the_page(grid_7x7: list[RunRecord], make_record: MakeRecord) -> None:
    records = [*grid_7x7[:-1], make_record("gt-grid", "FourRooms-7x7", 0, suite="grid-7x7", privileged=True)]
    text = "".join(Text(page_of(records)).words)
    [table] = tabulate(records, allow_missing=True)
    assert any("missing" in note for note in footnotes(table))
    for note in footnotes(table):
        assert note in text


def test_the_charts_have_the_tables_numbers(grid_7x7: list[RunRecord]) -> None:
    [section] = data_of(page_of(grid_7x7))["sections"]
    [table] = tabulate(grid_7x7)
    auc = table.rows[0].auc
    assert auc is not None
    assert auc.interval is not None
    [line] = [
        line for line in section["estimates"] if (line["agent"], line["task"], line["measure"]) == ("ppo", -1, "auc")
    ]
    assert (line["value"], line["low"], line["high"]) == pytest.approx((auc.value, *auc.interval), abs=1e-6)
    [curve] = [item for item in section["curves"] if item["agent"] == "ppo" and item["task"] == 0]
    assert curve["mean"] == [0.52] * 100
    assert curve["seeds"] == [0, 1, 2, 3, 4]


def test_improvement_of_one_agent_is_certain(grid_7x7: list[RunRecord]) -> None:
    [section] = data_of(page_of(grid_7x7))["sections"]
    assert section["improvements"] == [["ppo", "random", 1, 1, 1], ["random", "ppo", 0, 0, 0]]


def test_the_same_records_give_the_same_page(grid_7x7: list[RunRecord]) -> None:
    assert page_of(grid_7x7) == page_of(grid_7x7)


def test_incomparable_runs_are_named_and_have_no_table(make_record: MakeRecord) -> None:
    records = [make_record(seed=0), make_record("icm", seed=0, fingerprint="0" * 16)]
    page = page_of(records)
    assert "Incomparable: suite &#39;smoke&#39;, task FourRooms-7x7: environment fingerprint differs" in page
    assert data_of(page)["sections"][0]["curves"] == []


def test_failed_runs_show_their_error(make_record: MakeRecord) -> None:
    failed = Progress(make_record(seed=1).spec, "failed", 10, None, "ValueError: <b>")
    text = "".join(Text(page_of([make_record(seed=0)], progress=[failed])).words)
    assert "ValueError: <b>" in text
    assert "2 runs: 1 failed, 1 finished." in text


def test_runs_that_have_only_begun_make_a_page(make_record: MakeRecord) -> None:
    spec = make_record().spec
    logged = [(spec, [{"env_steps": 1000, "wall_time_s": 1.0, "return": 0.5, "loss": None}])]
    page = page_of([], progress=[Progress(spec, "running", 1000, 60.0)], logged=logged)
    assert data_of(page)["metrics"]["names"] == ["return"]
    assert "No run is finished of smoke." in page


def test_the_time_left_of_all_runs_is_shown_while_some_go_on(
    make_record: MakeRecord, tmp_path: Path, capsys: Capture
) -> None:
    going, waiting = (make_record(seed=seed).spec for seed in (0, 1))
    for spec in (going, waiting):
        write(spec.path(tmp_path / "runs") / "spec.json", spec)
    budget = going.task.budget
    line = {"env_steps": budget // 2, "wall_time_s": 60.0}
    output = tmp_path / "report.html"
    with lock(going.path(tmp_path / "runs")):
        call(capsys, "report", tmp_path / "runs", "-o", output)
        assert "2 runs: 1 running, 1 waiting. ? left." in output.read_text()
        (going.path(tmp_path / "runs") / "metrics.jsonl").write_text(f"{json.dumps(line)}\n")
        call(capsys, "report", tmp_path / "runs", "-o", output)
        assert "2 runs: 1 running, 1 waiting. 3 min 00 s left." in output.read_text()
    call(capsys, "report", tmp_path / "runs", "-o", output)
    assert "2 runs: 1 interrupted, 1 waiting. ? left." in output.read_text()


@pytest.mark.parametrize("text", ["</script><script>alert(1)</script>", "<!--<script>", "a & b", "\u2028", '"\\'])
def test_no_text_ends_the_data(text: str) -> None:
    written = str(embedded({text: text}))
    assert not set("<>&") & set(written)
    assert json.loads(written) == {text: text}


def test_many_metrics_are_means_in_fewer_bins(make_record: MakeRecord) -> None:
    lines = [{"env_steps": step, **{f"m{n}": float(n) for n in range(60)}} for step in range(1000, 100_000, 1000)]
    logged = [(make_record(seed=seed).spec, lines) for seed in range(50)]
    found = metrics_of(logged)
    assert found["means_only"]
    assert found["lines"][1]["runs"] == []
    assert set(found["lines"][3]["mean"]) <= {float(found["names"][3][1:]), None}


def test_an_interval_holds_its_probability() -> None:
    generator = np.random.default_rng(0)
    ours, theirs = generator.random((5, 3)) + 0.2, generator.random((7, 3))
    wins = [(a > b) + 0.5 * (a == b) for t in range(3) for a in ours[:, t] for b in theirs[:, t]]
    value = scores.probability_of_improvement(ours, theirs)
    assert value == pytest.approx(np.mean(wins))
    interval = scores.improvement_interval(ours, theirs, np.random.default_rng(1))
    assert interval is not None
    assert 0 <= interval.low < value < interval.high <= 1
    assert scores.probability_of_improvement(ours, ours) == pytest.approx(0.5)
    assert scores.improvement_interval(ours[:1], theirs, np.random.default_rng(1)) is None


def test_a_profile_counts_the_runs_above() -> None:
    profile = scores.performance_profile(np.array([[0.1, 0.9], [0.3, 0.9]]), np.array([0.0, 0.2, 0.5, 1.0]))
    assert profile.tolist() == [1.0, 0.75, 0.5, 0.0]


def test_the_command_writes_runs_and_boards(
    grid_7x7: list[RunRecord], write_runs: WriteRuns, home: Path, tmp_path: Path, capsys: Capture
) -> None:
    runs, output = write_runs(grid_7x7), tmp_path / "report.html"
    for source in ([runs], [home / "grid-7x7"], [runs, "--against", home / "grid-7x7"]):
        assert call(capsys, "report", *source, "-o", output)[0] == 0
        assert output.read_text().startswith("<!DOCTYPE html>")
    assert "ppo of the runs" in output.read_text()


def test_bad_input_is_one_sentence_and_writes_nothing(
    grid_7x7: list[RunRecord], write_runs: WriteRuns, tmp_path: Path, capsys: Capture
) -> None:
    runs, output, empty = write_runs(grid_7x7), tmp_path / "report.html", tmp_path / "empty"
    empty.mkdir()
    assert "There are no runs in" in refused(capsys, "report", empty, "-o", output)[1]
    assert "no-such-board" in refused(capsys, "report", "no-such-board", "-o", output)[1]
    assert "must end in .html" in refused(capsys, "report", runs, "-o", tmp_path / "report.pdf")[1]
    record = next(runs.rglob("record.json"))
    refused(capsys, "report", runs, "-o", record / "report.html")
    record.write_text("{")
    assert str(record) in refused(capsys, "report", runs, "-o", output)[1]
    assert not list(tmp_path.glob("*.html"))


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="there is no /dev/full")
def test_an_output_that_cannot_be_written_is_named(
    grid_7x7: list[RunRecord], write_runs: WriteRuns, tmp_path: Path, capsys: Capture
) -> None:
    runs, locked = write_runs(grid_7x7), tmp_path / "locked"
    locked.mkdir(mode=0o500)
    for output in (Path("/proc/report.html"), Path("/dev/full"), *([locked / "report.html"] if os.geteuid() else [])):
        status, sentence = refused(capsys, "report", runs, "-o", output)
        assert status == 1
        assert sentence.startswith(f"{output}: ")
    assert not list(locked.iterdir())


def test_an_old_report_outlives_a_broken_record(
    grid_7x7: list[RunRecord], write_runs: WriteRuns, tmp_path: Path, capsys: Capture
) -> None:
    runs, output = write_runs(grid_7x7), tmp_path / "report.html"
    output.write_text("old")
    broken = next(runs.rglob("record.json"))
    broken.write_text("{")
    assert str(broken) in refused(capsys, "report", runs, "-o", output)[1]
    assert output.read_text() == "old"
    assert [path.name for path in tmp_path.iterdir() if path.is_file()] == ["report.html"]
    assert call(capsys, "report", runs, "-o", output, "--allow-missing")[0] == 0
    assert f"Cannot be read: {broken}" in html.unescape(output.read_text())


def test_a_name_that_is_neither_runs_nor_a_board_is_refused_with_both(tmp_path: Path, capsys: Capture) -> None:
    for words in (["report", tmp_path / "no-runs"], ["report", "no-board"]):
        _, sentence = refused(capsys, *words, "-o", tmp_path / "report.html")
        assert "There is no folder" in sentence
        assert "grid-7x7" in sentence
    assert not list(tmp_path.iterdir())


def test_an_address_that_is_not_to_be_had_is_named(
    grid_7x7: list[RunRecord], write_runs: WriteRuns, address: tuple[str, int], capsys: Capture
) -> None:
    runs = write_runs(grid_7x7)
    assert f"port is {address[1]}; it must be free" in refused(capsys, "watch", runs, "--port", address[1])[1]
    for host in ("192.0.2.1", "no such host"):
        assert f"host is '{host}'; it must be an address" in refused(capsys, "watch", runs, "--host", host)[1]
    assert "--port" in refused(capsys, "watch", runs, "--port", 99_999)[1]


@pytest.fixture
def address(make_record: MakeRecord, write_runs: WriteRuns) -> Iterator[tuple[str, int]]:
    pages = iter(f"page {number}" for number in range(100))
    server = make_server(lambda: next(pages), every_s=0)
    thread = threading.Thread(target=server.serve_forever, kwargs={"poll_interval": 0.01})
    thread.start()
    yield server.server_address[:2]  # type: ignore[misc]
    server.shutdown()
    thread.join()
    server.server_close()


def ask(address: tuple[str, int], path: str, method: str = "GET", **headers: str) -> tuple[int, bytes, str]:
    connection = http.client.HTTPConnection(*address, timeout=10)
    connection.request(method, path, headers=headers)
    answer = connection.getresponse()
    found = answer.status, answer.read(), answer.headers.get("ETag", "")
    connection.close()
    return found


def test_the_server_gives_one_fresh_page_and_nothing_else(address: tuple[str, int]) -> None:
    assert address[0] == "127.0.0.1"
    assert ask(address, "/")[:2] == (200, b"page 1")
    assert ask(address, "/")[:2] == (200, b"page 2")
    for path in ("/etc/passwd", "/../pyproject.toml", "/record.json", "/runs/"):
        assert ask(address, path)[0] == 404
    assert ask(address, "/", "POST")[0] == 501
    assert ask(address, "/", Host="evil.example:80")[0] == 403
    assert ask(address, "/", "HEAD")[1] == b""


def test_a_broken_file_keeps_the_last_page(make_record: MakeRecord, caplog: pytest.LogCaptureFixture) -> None:
    def pages() -> Iterator[str]:
        yield "good"
        raise ValueError("broken")

    made = pages()
    server = make_server(lambda: next(made), every_s=0)
    thread = threading.Thread(target=server.serve_forever, kwargs={"poll_interval": 0.01})
    thread.start()
    try:
        assert ask(server.server_address[:2], "/")[:2] == (200, b"good")  # type: ignore[arg-type]
    finally:
        server.shutdown()
        thread.join()
        server.server_close()
    assert "broken" in caplog.text


def test_watch_needs_a_folder_or_nothing_there(tmp_path: Path, capsys: Capture) -> None:
    (tmp_path / "file").touch()
    assert "it must be a folder with runs." in refused(capsys, "watch", tmp_path / "file")[1]
    assert "There are no runs in" in refused(capsys, "watch", tmp_path)[1]


def test_watch_waits_for_runs(tmp_path: Path, capsys: Capture, monkeypatch: pytest.MonkeyPatch) -> None:
    pages: list[str] = []
    monkeypatch.setattr(ThreadingHTTPServer, "serve_forever", lambda _server: None)
    monkeypatch.setattr("sprl_bench.report.make_server", _keeping(pages))
    for folder in (tmp_path / "nothing", tmp_path):
        status, _, told = call(capsys, "watch", folder, "--port", 0)
        assert status == 0
        assert f"There are no runs in {folder} yet. The page waits for them." in told
        assert f"There are no runs in {folder} yet." in pages[-1]


def _keeping(pages: list[str]) -> Callable[..., Any]:
    """Return a maker of servers that keeps the first page of each."""

    def make(page: Callable[[], str], **others: Any) -> Any:
        pages.append(page())
        return make_server(page, **others)

    return make


def test_an_error_is_read_from_the_runs_folder(make_record: MakeRecord, tmp_path: Path, capsys: Capture) -> None:
    record = make_record()
    folder = record.spec.path(tmp_path / "runs")
    write(folder / "spec.json", record.spec)
    (folder / "error.txt").write_text("Traceback\nRuntimeError: out of luck\n")
    assert call(capsys, "report", tmp_path / "runs", "-o", tmp_path / "report.html")[0] == 0
    assert "RuntimeError: out of luck" in (tmp_path / "report.html").read_text()
