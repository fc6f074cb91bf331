"""Build the site: `python docs/site/build.py build/site`.

The site has the structure of the repository, so that every link between pages works here as on GitHub. This program
copies the pages and what they show into a folder, writes the pages that come from code (commands, Python, environments,
boards, and citing), adds the table of contents, and calls Sphinx. Warnings are errors.
"""

from __future__ import annotations

import inspect
import re
import shutil
import sys
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import boards
import citation
import families
import typer
from films import FILMS
from sphinx.cmd.build import build_main

import sprl_bench
from sprl_bench.cli.app import app

ROOT: Final = Path(__file__).resolve().parents[2]
HERE: Final = Path(__file__).resolve().parent
ROOMS: Final[Mapping[str, str]] = {
    "The data frames": "sprl_bench.frames",
    "The exact solver": "sprl_bench.solver",
    "The constraint on small worlds": "sprl_bench.theory",
    "Scores": "sprl_bench.scores",
    "Pictures": "sprl_bench.plots",
    "The report": "sprl_bench.report",
}
"""Modules whose names are public, besides those of `sprl_bench`, by their titles."""
BOARDS: Final = ROOT / "leaderboards"
ASSETS: Final = (HERE / "site.css", HERE / "site.js")
LINK: Final = re.compile(r"\[(?P<text>[^\]]*)\]\((?P<target>[^)#\s]+)(?P<place>#[^)\s]*)?\)")
INTERVAL: Final = re.compile(r"\[([-+]?\d[\d.,]*), ([-+]?\d[\d.,]*)\]")
"""An interval in text, which no line break should part."""
CONTENTS: Final[Mapping[str, Sequence[str]]] = {
    "Guide": (
        "Start <README>",
        "docs/environments",
        "docs/recording",
        "docs/experiments",
        "docs/clusters",
        "docs/scores",
        "docs/trust",
    ),
    "Frameworks": (
        "docs/frameworks/README",
        "docs/frameworks/stable-baselines3",
        "docs/frameworks/cleanrl",
        "docs/frameworks/gymnasium",
        "docs/frameworks/torchrl",
        "docs/frameworks/tianshou",
        "docs/frameworks/rllib",
        "docs/frameworks/skrl",
        "docs/frameworks/minari",
    ),
    "Results": (
        "docs/results",
        "docs/fetch",
        "docs/reproduction",
        "docs/speed",
        "docs/theory",
        "docs/optimality",
        "leaderboards/README",
    ),
    "Reference": (
        "generated/environments",
        "generated/commands",
        "generated/python",
        "baselines/README",
        "docs/hyperparameters",
    ),
    "Project": ("CONTRIBUTING", "SECURITY", "CHANGELOG", "notes/README"),
}


def main(target: Path) -> int:
    """Build the site into `target`, and return Sphinx's exit status."""
    with tempfile.TemporaryDirectory() as folder:
        source = Path(folder)
        stage(source)
        return build_main(["-W", "--keep-going", "-q", "-b", "html", str(source), str(target)])


def stage(source: Path) -> None:
    """Lay the site's sources into a folder."""
    shutil.copy(HERE / "conf.py", source)
    for page in _pages():
        _copy(page, source)
    generated = source / "generated"
    generated.mkdir()
    (generated / "commands.md").write_text("\n".join(_commands()), encoding="utf-8")
    (generated / "python.md").write_text("\n".join(_python()), encoding="utf-8")
    for name, text in _generated().items():
        (generated / f"{name}.md").write_text(_unbroken(text), encoding="utf-8")
    boards.write_reports(BOARDS, source / "extra" / "boards")
    with (source / "docs" / "results.md").open("a", encoding="utf-8") as results:
        results.write(boards.beside_results(boards.names_of(BOARDS)))
    for film in FILMS:
        _put(Path(film.path), source)
    for asset in ASSETS:
        _put(asset.relative_to(ROOT), source)
    index = (HERE / "index.md").read_text(encoding="utf-8").replace("<!-- gallery -->", families.home_gallery())
    (source / "index.md").write_text("\n".join((index, *_contents(_all_parts()))), encoding="utf-8")
    with (source / "notes" / "README.md").open("a", encoding="utf-8") as notes:
        notes.write("\n".join(("", *_contents({"": _notes()}))))


def _generated() -> dict[str, str]:
    """Return the pages of environments and boards, and that on citing, by their names."""
    return {
        "environments": families.overview(),
        **{family.name: families.page_of(family) for family in families.FAMILIES},
        "boards": boards.overview(boards.names_of(BOARDS)),
        **{f"board-{name}": boards.page_of(BOARDS, name) for name in boards.names_of(BOARDS)},
        "citation": citation.page_of(ROOT / "CITATION.cff"),
    }


def _pages() -> list[Path]:
    """Return all pages of the repository, relative to its root."""
    found = [*ROOT.glob("*.md"), *(ROOT / "docs").glob("*.md"), *(ROOT / "notes").rglob("*.md")]
    found += (ROOT / "docs" / "frameworks").glob("*.md")
    found += [ROOT / "baselines" / "README.md", ROOT / "leaderboards" / "README.md"]
    return sorted(path.relative_to(ROOT) for path in found)


def _all_parts() -> dict[str, Sequence[str]]:
    """Return the table of contents, with every other page of `docs` at the end of the guide."""
    known = {page for pages in CONTENTS.values() for page in pages} | {"docs/atari", "docs/mazes"}
    others = [str(page.with_suffix("")) for page in _pages() if page.parts[0] == "docs"]
    return {
        "Guide": [*CONTENTS["Guide"], *(page for page in others if page not in known)],
        "Environments": [
            *(f"generated/{family.name}" for family in families.FAMILIES),
            "Mazes: suite and commands <docs/mazes>",
            "Atari: rules and commands <docs/atari>",
        ],
        **{name: pages for name, pages in CONTENTS.items() if name not in ("Guide", "Project")},
        "Boards": ["generated/boards", *(f"generated/board-{name}" for name in boards.names_of(BOARDS))],
        "Project": ["generated/citation", *CONTENTS["Project"]],
    }


def _notes() -> list[str]:
    """Return the pages of the folder `notes` but its first, relative to it."""
    found = (page.relative_to("notes") for page in _pages() if page.parts[0] == "notes")
    return [str(page.with_suffix("")) for page in found if page.name != "README.md"]


def _copy(page: Path, source: Path) -> None:
    """Copy a page and the files that it links to."""
    folder = (ROOT / page).parent
    text = LINK.sub(lambda link: _linked(link, folder, source), (ROOT / page).read_text(encoding="utf-8"))
    (source / page).parent.mkdir(parents=True, exist_ok=True)
    (source / page).write_text(_unbroken(text), encoding="utf-8")


def _unbroken(text: str) -> str:
    """Return a text in which no line break parts an interval."""
    return INTERVAL.sub("[\\1,\N{NO-BREAK SPACE}\\2]", text)


def _linked(link: re.Match[str], folder: Path, source: Path) -> str:
    """Return a link for the site: to a folder's page instead of the folder, or its text alone if there is no page."""
    linked = folder / link["target"]
    if "://" in link["target"] or not linked.exists():
        return link[0]
    if linked.is_dir():
        page = f"{link['target'].rstrip('/')}/README.md"
        return f"[{link['text']}]({page})" if (folder / page).exists() else link["text"]
    if linked.suffix != ".md":
        _put(linked.resolve().relative_to(ROOT), source)
    return link[0]


def _put(file: Path, source: Path) -> None:
    (source / file).parent.mkdir(parents=True, exist_ok=True)
    shutil.copy(ROOT / file, source / file)


def _contents(parts: Mapping[str, Sequence[str]]) -> Iterator[str]:
    """Yield a hidden table of contents for each part of the site; the part without a name is not shown beside pages."""
    for name, pages in parts.items():
        yield "```{toctree}"
        yield ":hidden:"
        yield f":caption: {name}" if name else ":maxdepth: 1"
        yield ""
        yield from pages
        yield "```\n"


# --------------------------------------------------------------------------- pages from code


def _commands() -> Iterator[str]:
    """Yield the help of every command."""
    yield "# Commands\n"
    yield "Everything that a command does is one public function away: [Python](python.md).\n"
    yield from _help_of(typer.main.get_command(app), ("sprl-bench",))


def _help_of(command: Any, names: tuple[str, ...]) -> Iterator[str]:
    subcommands = getattr(command, "commands", {})
    if not subcommands:
        context = command.context_class(command, info_name=" ".join(names), terminal_width=86, max_content_width=86)
        yield f"## {' '.join(names)}\n\n```text\n{command.get_help(context)}\n```\n"
    for name, subcommand in subcommands.items():
        yield from _help_of(subcommand, (*names, name))


def _python() -> Iterator[str]:
    """Yield the public names, room by room."""
    yield "# Python\n"
    yield "`import sprl_bench` registers the environments. The names below can be imported from `sprl_bench`; "
    yield "modules with more are at the end.\n"
    for name in sprl_bench.__all__:
        value = getattr(sprl_bench, name)
        directive, option = _directive(value)
        yield _documented(name, directive, f"sprl_bench.{name}", option)
    for title, room in ROOMS.items():
        yield _documented(title, "automodule", room, ":members:")


def _documented(title: str, directive: str, name: str, option: str) -> str:
    return f"## {title}\n\n```{{eval-rst}}\n.. {directive}:: {name}\n   {option}\n```\n"


def _directive(value: Any) -> tuple[str, str]:
    """Return the directive that documents a value, and its option."""
    if not callable(value):
        return "autodata", ":no-value:"
    if not inspect.isclass(value):
        return "autofunction", ""
    return "autoclass", "" if hasattr(value, "model_fields") else ":members:"


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1])))
