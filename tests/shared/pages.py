"""What the pages for users hold: their text, their links, and the blocks of code that a reader would try."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Final, NamedTuple

ROOT: Final = Path(__file__).parents[2]
TRIED: Final = ("README.md", "docs/*.md", "baselines/README.md", "leaderboards/README.md")
PROSE: Final = (*TRIED, "docs/frameworks/*.md", "CHANGELOG.md", "CONTRIBUTING.md", "notes/*.md")
COMMAND: Final = "sprl-bench "
SHELLS: Final = ("", "bash", "console")
SKIP: Final = re.compile(r"<!-- test: skip because (.{10,}) -->")
LINK: Final = re.compile(r"\]\((?!https?:)([^)#\s]+)(?:#([^)]+))?\)")


class Block(NamedTuple):
    """One fenced block of a page."""

    page: str
    line: int  # of its first line of code, from 1
    language: str
    code: str
    skipped: str  # the reason why it cannot be tried; empty where it can

    @property
    def commands(self) -> list[str]:
        """The commands of ours in it, each on one line."""
        lines = self.code.replace("\\\n", " ").splitlines()
        return [line for line in (line.removeprefix("$ ") for line in lines) if line.startswith(COMMAND)]

    @property
    def is_tried(self) -> bool:
        """Whether a reader would type it."""
        return self.language == "python" or (self.language in SHELLS and bool(self.commands))


def pages(patterns: tuple[str, ...]) -> list[str]:
    """Return the names of pages, relative to the root."""
    return [path.relative_to(ROOT).as_posix() for pattern in patterns for path in sorted(ROOT.glob(pattern))]


def text_of(page: str) -> str:
    return (ROOT / page).read_text(encoding="utf-8")


def words_of(page: str) -> int:
    return len(text_of(page).split())


def broken_links(page: str) -> list[str]:
    """Return the relative links and images whose file or heading does not exist."""
    folder = (ROOT / page).parent
    return [
        f"{target}#{heading}" for target, heading in LINK.findall(text_of(page)) if not _leads(folder / target, heading)
    ]


def _leads(path: Path, heading: str) -> bool:
    return path.exists() and (not heading or heading in _headings(path.read_text(encoding="utf-8")))


def _headings(text: str) -> list[str]:
    """Return the names by which a page's headings are linked."""
    titles = re.findall(r"^#+ (.+)$", text, re.MULTILINE)
    return [re.sub(r"[^\w -]", "", title).lower().replace(" ", "-") for title in titles]


def blocks_of(page: str) -> list[Block]:
    """Return the blocks of a page that a reader would try, in their order."""
    return [block for block in _all_blocks(page) if block.is_tried]


def _all_blocks(page: str) -> Iterator[Block]:
    lines = text_of(page).splitlines()
    fences = [number for number, line in enumerate(lines) if line.startswith("```")]
    for start, end in zip(fences[::2], fences[1::2], strict=True):
        skip = SKIP.fullmatch(lines[start - 1])
        code = "\n".join(lines[start + 1 : end])
        yield Block(page, start + 2, lines[start].removeprefix("```"), code, skip[1] if skip else "")
