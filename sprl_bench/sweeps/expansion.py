"""From ranges to settings, and from settings to the specs of all runs."""

from __future__ import annotations

import itertools
import json
import tomllib
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from sprl_bench.agents import load_factory, resolve_hyperparameters
from sprl_bench.naming import AgentName
from sprl_bench.records import RunSpec
from sprl_bench.records.files import read_bytes, refuse_mark
from sprl_bench.suite import expand
from sprl_bench.sweeps.declaration import Declaration, Setting
from sprl_bench.tasks import find_suite

Ranges = Mapping[str, Sequence[Any]]


def table_ranges(agent: str, domain: str) -> list[Ranges]:
    """Return, as one table, the ranges that the paper's table of a domain has for an agent.

    Raises:
        ValueError: It has none.
    """
    ranges = getattr(load_factory(AgentName.parse(agent).source), "ranges", None)
    found: Ranges = ranges(domain) if ranges is not None else {}
    if not found:
        raise ValueError(
            f"range is 'table'; it must be a file for {agent}, of which the paper has no range on {domain}."
        )
    return [found]


def read_ranges(path: Path, agents: Sequence[str]) -> dict[str, list[Ranges]]:
    """Read the ranges of these agents from a TOML or JSON file: a table an agent, with a list of values a key.

    An agent may have several tables, as an array, for hyperparameters that change together.

    Raises:
        FileNotFoundError: There is no such file.
        ValueError: It is no such file, or lacks one of the agents.
    """
    written = read_bytes(path)
    refuse_mark(path, written)
    try:
        text = written.decode()
        content = json.loads(text) if path.suffix.lower() == ".json" else tomllib.loads(text)
    except (ValueError, RecursionError) as error:
        raise ValueError(f"range is {path}; it must be TOML, or JSON in a .json file: {error}.") from None
    if not isinstance(content, dict):
        raise ValueError(f"range is {path}; it must hold a table for each agent.")
    for agent in agents:
        if agent not in content:
            there = ", ".join(content) or "none"
            raise ValueError(f"range is {path}; it must have a table [{agent}], and has {there}.")
    return {agent: _tables(path, agent, content[agent]) for agent in agents}


def _tables(path: Path, agent: str, written: object) -> list[Ranges]:
    """Return the checked tables of one agent."""
    tables: list[Any] = written if isinstance(written, list) and written else [written]
    for table in tables:
        if not isinstance(table, dict) or not table:
            raise ValueError(f"{path}: {agent} is {written!r}; it must be a table of hyperparameters.")
        if table.keys() != tables[0].keys():
            raise ValueError(
                f"{path}: one table of {agent} holds {', '.join(sorted(table))}; all must hold the same, "
                f"{', '.join(sorted(tables[0]))}."
            )
        for key, values in table.items():
            if not isinstance(values, list) or not values:
                raise ValueError(f"{path}: {agent}.{key} is {values!r}; it must be a list of values.")
    return tables


def settings_of(
    agent: str, domain: str, tables: Sequence[Ranges], samples: int | None = None, sampling_seed: int = 0
) -> list[Setting]:
    """Return the settings of an agent: all combinations of each table, or some of them.

    Args:
        agent: An agent's name, which may have a preset and differences of its own.
        domain: Of the tasks.
        tables: Values of each hyperparameter; the same hyperparameters in each.
        samples: How many combinations to draw, without repetition; all by default, or if there are no more.
        sampling_seed: Decides which.

    Raises:
        ValueError: A hyperparameter is unknown or in the agent's name too, or a value is out of range or given twice.
    """
    name = AgentName.parse(agent)
    for key, values in itertools.chain.from_iterable(ranges.items() for ranges in tables):
        if key in name.differences:
            raise ValueError(f"agents holds {agent!r}; it must not give {key}, which the sweep varies.")
        if len(set(map(repr, values))) < len(values):
            raise ValueError(f"{key} of {agent} is {list(values)}; it must have each value once.")
    combinations = [
        dict(zip(ranges, values, strict=True)) for ranges in tables for values in itertools.product(*ranges.values())
    ]
    if samples is not None and samples < len(combinations):
        chosen = np.random.default_rng(sampling_seed).choice(len(combinations), samples, replace=False)
        combinations = [combinations[number] for number in sorted(chosen.tolist())]
    settings = [_setting(name, domain, values) for values in combinations]
    if twice := [one for one, count in Counter(setting.name for setting in settings).items() if count > 1]:
        raise ValueError(f"The tables of {agent} give {twice[0]} twice; they must give each setting once.")
    return settings


def _setting(name: AgentName, domain: str, values: Mapping[str, Any]) -> Setting:
    """Return a setting under its shortest name: values that are the preset's own are left out."""
    factory = load_factory(name.source)
    chosen = resolve_hyperparameters(factory, domain, {**name.differences, **values}, name.preset)
    resolved = {"num_envs": chosen.num_envs, **chosen.values}
    full = AgentName(name.source, name.preset, dict(chosen.differences))
    return Setting(name=full.full, values={key: resolved[key] for key in values})


def specs_of(declaration: Declaration, device: str = "cpu") -> list[RunSpec]:
    """Return the specs of all runs of a sweep.

    Raises:
        ValueError: Something in it is unknown or not allowed.
    """
    suite = find_suite(declaration.suite)
    return [
        spec
        for task, budget in declaration.tasks.items()
        for spec in expand(suite, declaration.names, declaration.seeds, tasks=[task], budget=budget, device=device)
    ]
