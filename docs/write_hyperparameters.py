"""Write the page of all hyperparameters: `python docs/write_hyperparameters.py docs/hyperparameters.md`.

What each means is its comment in its config class.
"""

from __future__ import annotations

import inspect
import json
import re
import sys
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Annotated, Any, Final, get_args, get_origin, get_type_hints

from sprl_baselines.count import CountConfig
from sprl_baselines.eco import ECOConfig
from sprl_baselines.gt_grid import GTGridConfig
from sprl_baselines.icm import ICMConfig
from sprl_baselines.learning.config import Config
from sprl_baselines.ppo import PPOConfig
from sprl_baselines.presets import DOMAINS
from sprl_baselines.reachability.hyperparameters import HorizonConfig, ReachabilityConfig
from sprl_baselines.rnd import RNDConfig
from sprl_baselines.sprl import ConstraintConfig

HEAD: Final = """# Hyperparameters

All hyperparameters of all agents. `--set NAME=VALUE` changes one. The record of a run holds the values that were used.

**Defaults and presets.** An agent's plain name means its preset `table`: `sprl` has the settings of the paper's
table for the domain. A preset changes some of the defaults ([the last table](#what-presets-change)), and presets do not
add up. The defaults are those of the grids, but `sprl` and `gt-sprl` get Table 1's rate of 0.01 from `table`;
`sprl@tuned` has the default rate of 0.003.

**Words.** A *domain* is a family of tasks; the task decides which rows of the last table hold. `dmlab` stands for
first-person mazes. *Anchor*, *positive* and *negative* are states from which the reachability network learns: a
positive lies a few steps after its anchor, a negative many. *CReLU* is the rectifier of x and of -x, side by side. The
agents' `action_noise` is not the environments' argument of that name, which the suite `noise` sets.

`python docs/write_hyperparameters.py docs/hyperparameters.md` writes this page.
"""
SECTIONS: Final[Mapping[str, type[Config]]] = {
    "All agents: the learner": PPOConfig,
    "`icm`": ICMConfig,
    "`gt-grid`": GTGridConfig,
    "`eco`, `sprl`, `gt-sprl`: what counts as reached": HorizonConfig,
    "`eco`, `sprl`: the reachability network": ReachabilityConfig,
    "`eco`": ECOConfig,
    "`sprl`, `gt-sprl`: the cost": ConstraintConfig,
    "`rnd`": RNDConfig,
    "`count`": CountConfig,
}
FIELD: Final = re.compile(r"^    (\w+): .+? = [^#]+?(?:  # (.+))?$")
COMMENT: Final = re.compile(r"^    # (.+)$")


def page() -> str:
    """Return the whole page."""
    sections = (line for title, kind in SECTIONS.items() for line in _section(title, kind))
    return "\n".join([HEAD, *sections, *_presets()])


def _section(title: str, kind: type[Config]) -> Iterator[str]:
    yield from (f"## {title}", "", "| name | default | allowed | meaning |", "| --- | --- | --- | --- |")
    defaults, hints = kind().as_dict(), get_type_hints(kind, include_extras=True)
    for name, meaning in _meanings(kind):
        yield f"| `{name}` | {json.dumps(defaults[name])} | {_allowed(hints[name])} | {meaning} |"
    yield ""


def _meanings(kind: type[Config]) -> Iterator[tuple[str, str]]:
    """Yield each field of a class and its comment: the one behind it, or those above."""
    above: list[str] = []
    for line in inspect.getsource(kind).splitlines():
        if comment := COMMENT.match(line):
            above.append(comment[1])
        elif field := FIELD.match(line):
            yield field[1], field[2] or " ".join(above)
            above = []


def _allowed(annotation: Any) -> str:
    if get_origin(annotation) is not Annotated:
        return {bool: "true, false", float: "any"}[annotation]
    return ", ".join(map(str, get_args(annotation)[1:]))


def _presets() -> Iterator[str]:
    yield from ("## What presets change", "", "| domain | preset | agent | values |", "| --- | --- | --- | --- |")
    for domain, presets in DOMAINS.items():
        for name, settings in presets.items():
            for agent, values in settings.items():
                changed = ", ".join(f"`{key}` {json.dumps(value)}" for key, value in values.items())
                yield f"| {domain} | {name} | {agent} | {changed or 'nothing'} |"
    yield ""


if __name__ == "__main__":
    if len(sys.argv) != 2:
        sys.exit("The file to write is missing: python docs/write_hyperparameters.py docs/hyperparameters.md")
    Path(sys.argv[1]).write_text(page(), encoding="utf-8")
