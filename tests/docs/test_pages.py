"""The pages for users: their code and commands run, their links lead somewhere, and they stay short.

Every Python block and every `sprl-bench` command is run in the order of its page, in a folder of the page's own. A
block that begins with a comment such as `# my_agent.py` is saved under that name, too. What makes this quick:

- the budget of the suite `smoke` is 2,000 steps, and its runs are computed in this process;
- a run with a larger budget is not computed: a made-up finished record is laid down before the command;
- a block below `<!-- test: skip because REASON -->` is left out.
"""

from __future__ import annotations

import functools
import re
import shlex
import shutil
import sys
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, Final

import pytest
from pages import PROSE, ROOT, TRIED, Block, blocks_of, broken_links, pages, text_of, words_of

from sprl_bench import executors, suite
from sprl_bench.cli import main
from sprl_bench.recorder.fingerprint import fingerprint
from sprl_bench.records import RunRecord, RunSpec, read, write
from sprl_bench.records.folder import RECORD
from sprl_bench.tasks import SUITES

LONGEST: Final = 2_000  # env steps of a run that is computed
FILE: Final = re.compile(r"# (\w+\.py)\b")
NAMED: Final = re.compile(r"(?<![\w/])((?:docs|notes|benchmarks|baselines|sprl_bench)/[\w./-]+\.(?:py|md|png|gif))\b")
BLOCKS: Final = [block for page in pages(TRIED) for block in blocks_of(page)]
LIMITS: Final = {
    "docs/atari.md": 500,
    "docs/clusters.md": 400,
    "docs/experiments.md": 800,
    "docs/fetch.md": 800,
    "docs/mazes.md": 450,
    "docs/optimality.md": 600,
    "docs/report.md": 300,
    "docs/reproduction.md": 920,
    "docs/statistics.md": 520,
    "docs/trust.md": 580,
}
MakeRecord = Callable[..., RunRecord]


class Here:
    """Runs in this process, one after the other."""

    def map(self, function: Callable[[RunSpec], Any], specs: Sequence[RunSpec]) -> Iterator[tuple[RunSpec, Any]]:
        for spec in specs:
            yield spec, function(spec)


class Reader:
    """Someone who tries what a page says, from its top to its end."""

    def __init__(self, page: str, folder: Path) -> None:
        self.folder = folder
        self._waiting = blocks_of(page)
        self._names: dict[str, Any] = {"__name__": "__main__"}
        shutil.copytree(ROOT / "leaderboards", folder / "leaderboards")

    def read_to(self, last: Block) -> None:
        """Try what has not been tried yet, up to this block."""
        while last in self._waiting:
            block = self._waiting.pop(0)
            if not block.skipped:
                self._try(block)

    def _try(self, block: Block) -> None:
        if block.language == "python":
            self._save(block.code)
            lines_above = "\n" * (block.line - 1)  # so that a traceback names the line of the page
            exec(compile(lines_above + block.code, block.page, "exec"), self._names)
        for command in block.commands:
            assert main(shlex.split(command)[1:]) == 0, f"{block.page}:{block.line}: {command}"

    def _save(self, code: str) -> None:
        if name := FILE.match(code):
            (self.folder / name[1]).write_text(code, encoding="utf-8")


@pytest.fixture(scope="module")
def reader_of(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Reader]:
    """Return a function that gives the one reader of a page."""
    return functools.cache(lambda page: Reader(page, tmp_path_factory.mktemp(page.replace("/", "-"))))


@pytest.fixture
def short_smoke() -> Iterator[None]:
    """Shorten the budget of the suite `smoke`."""
    (task,) = SUITES["smoke"].tasks
    budget = task.budget
    object.__setattr__(task, "budget", LONGEST)  # it is frozen
    yield
    object.__setattr__(task, "budget", budget)


@pytest.fixture
def quick(monkeypatch: pytest.MonkeyPatch, make_record: MakeRecord, short_smoke: None) -> None:
    """Make up what takes long, and compute the rest in this process."""
    run_suite = suite.run_suite

    def run_quickly(specs: Sequence[RunSpec], out: Path, **rest: Any) -> Any:
        for spec in specs:
            if spec.task.budget > LONGEST:
                write(spec.path(out) / RECORD, made_up(make_record, spec))
        return run_suite(specs, out, **rest)

    monkeypatch.setattr(suite, "run_suite", run_quickly)
    monkeypatch.setattr(executors, "make_executor", lambda *_: Here())


def made_up(make_record: MakeRecord, spec: RunSpec) -> RunRecord:
    """Return a finished record of a run, its curve flat and different for each seed."""
    place = (spec.agent, spec.task.name, spec.seed)
    level = 0.3 + 0.01 * spec.seed
    return make_record(*place, suite=spec.suite, level=level, spec=spec, fingerprint=fingerprint(spec.task))


def forget_modules(folder: Path) -> None:
    """Let the next page have modules of the same names."""
    for name, module in list(sys.modules.items()):
        if Path(getattr(module, "__file__", None) or "/").is_relative_to(folder):
            del sys.modules[name]


@pytest.mark.usefixtures("quick")
@pytest.mark.parametrize("block", BLOCKS, ids=lambda block: f"{block.page}:{block.line}")
def test_what_a_page_says_can_be_done(
    block: Block, reader_of: Callable[[str], Reader], monkeypatch: pytest.MonkeyPatch
) -> None:
    if block.skipped:
        pytest.skip(block.skipped)
    reader = reader_of(block.page)
    monkeypatch.chdir(reader.folder)
    monkeypatch.setattr(sys, "path", [str(reader.folder), *sys.path])
    try:
        reader.read_to(block)
    finally:
        forget_modules(reader.folder)
    assert {read(path, RunRecord).status for path in reader.folder.rglob(RECORD)} <= {"complete"}


@pytest.mark.parametrize("page", pages(PROSE))
def test_every_link_leads_somewhere(page: str) -> None:
    assert not broken_links(page)


@pytest.mark.parametrize("page", pages(PROSE))
def test_every_file_that_is_named_exists(page: str) -> None:
    assert not [name for name in NAMED.findall(text_of(page)) if not (ROOT / name).exists()]


def test_the_readme_is_short() -> None:
    assert words_of("README.md") < 1300


def test_the_pages_for_users_are_short() -> None:
    others = {"docs/hyperparameters.md", *LIMITS}  # the first is written by a program
    written = [page for page in pages(("docs/*.md", "baselines/README.md")) if page not in others]
    assert sum(map(words_of, written)) < 7100


@pytest.mark.parametrize("page", LIMITS)
def test_each_later_page_is_short(page: str) -> None:
    assert words_of(page) < LIMITS[page]


def test_the_changelog_is_short() -> None:
    assert len([line for line in text_of("CHANGELOG.md").splitlines() if line.strip()]) <= 20


@pytest.mark.parametrize("name", ["keydoors.gif", "maze.gif"])
def test_moving_pictures_are_small(name: str) -> None:
    assert (ROOT / "docs" / name).stat().st_size < 1_000_000


def test_a_page_without_code_would_be_noticed() -> None:
    tried = {block.page for block in BLOCKS}
    assert {"README.md", "docs/environments.md", "docs/recording.md", "leaderboards/README.md"} <= tried
