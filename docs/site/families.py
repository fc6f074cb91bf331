"""The pages of the environments' families, from docstrings and films, and the gallery of the home page."""

from __future__ import annotations

import inspect
import re
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final

from films import ATARI, FETCH, FILMS, GRIDS, MAZES, MISSING, Film

from sprl_bench.envs.atari.atari_env import AtariEnv
from sprl_bench.envs.fetch.fetch_env import FlatFetch, GoalFetch
from sprl_bench.envs.grid.four_rooms import FourRooms
from sprl_bench.envs.grid.key_doors import KeyDoors
from sprl_bench.envs.maze.maze_env import MazeEnv


@dataclass(frozen=True)
class Family:
    """A family of environments.

    Attributes:
        name: Of its page.
        title: Of its page.
        about: A sentence on it.
        guide: The page of `docs` that shows how to use it.
        classes: Those whose docstrings describe it.
    """

    name: str
    title: str
    about: str
    guide: str
    classes: tuple[type, ...]


FAMILIES: Final = (
    Family(
        GRIDS,
        "Grids",
        "Small rooms seen from above, drawn anew for every episode. They need no extra.",
        "environments",
        (FourRooms, KeyDoors),
    ),
    Family(
        FETCH,
        "Fetch",
        "A robot arm that is paid only when the gripper or an object is at the goal, the red ball. "
        "It needs the extra `fetch`.",
        "environments",
        (FlatFetch, GoalFetch),
    ),
    Family(
        MAZES,
        "Mazes",
        "First-person mazes that need no extra, no OpenGL and no screen.",
        "mazes",
        (MazeEnv,),
    ),
    Family(ATARI, "Atari", "Six games with rare rewards. They need the extra `atari`.", "atari", (AtariEnv,)),
)
HOME: Final = ("key-doors-solver", "reach-ppo", "maze-solver", "atari-random")


def page_of(family: Family) -> str:
    """Return the page of a family, for the folder `generated`."""
    films = [film for film in FILMS if film.family == family.name]
    guide = f"Rules, suite and commands: [{family.guide}](../docs/{family.guide}.md)."
    missing = [f"{MISSING[family.name]}\n"] if family.name in MISSING else []
    top = [f"# {family.title}\n", f"{family.about} {guide}\n", gallery(films), *missing]
    return "\n".join([*top, *map(_described, family.classes)])


def _described(environment: type) -> str:
    return f"## {environment.__name__}\n\n{_deeper(inspect.cleandoc(environment.__doc__ or ''))}\n"


def _deeper(text: str) -> str:
    """Return Markdown with its headings one level lower."""
    return re.sub(r"^#(?=#* )", "##", text, flags=re.MULTILINE)


def overview() -> str:
    """Return the page that leads to all families."""
    rows = [f"| [{one.title}]({one.name}.md) | {one.about} |" for one in FAMILIES]
    return "\n".join(["# Environments in detail\n", "| family | |", "| --- | --- |", *rows, ""])


def home_gallery() -> str:
    """Return the gallery of the home page: a film of each family."""
    by_name, families = {film.name: film for film in FILMS}, {family.name: family for family in FAMILIES}
    shown = [(by_name[name], families[by_name[name].family]) for name in HOME]
    leads = {
        film: f"[{family.title}](generated/{family.name}.md): {film.title[0].lower()}{film.title[1:]}"
        for film, family in shown
    }
    return _gallery("gallery home", (_figure(film, ".", lead) for film, lead in leads.items()))


def gallery(films: Iterable[Film]) -> str:
    """Return films side by side, for a page in the folder `generated`, each with its caption."""
    return _gallery("gallery", (_figure(film, "..", film.title) for film in films))


def _gallery(name: str, figures: Iterable[str]) -> str:
    return "\n".join([f"::::{{container}} {name}", *figures, "::::\n"])


def _figure(film: Film, root: str, lead: str) -> str:
    """Return a film with its caption.

    Args:
        film: Which.
        root: The root of the site, as the page names it.
        lead: The first words of the caption.
    """
    spoken = f"{film.title}. {film.caption}".replace("`", "")
    return f":::{{figure}} {root}/{film.path}\n:alt: {spoken}\n\n**{lead}.** {film.caption}\n:::"
