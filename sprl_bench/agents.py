"""What an agent is, and how a name becomes one.

An agent owns its training loop and yields a few metrics after each update; the harness owns the clock, the progress
bar, the checkpoint and the budget. Nothing here knows how any agent works.
"""

from __future__ import annotations

import importlib
import inspect
import re
import traceback
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from importlib.metadata import entry_points
from typing import Any, Final, Protocol, runtime_checkable

from gymnasium import Space
from gymnasium.vector import VectorEnv

from sprl_bench.suggestions import unknown

FORM: Final = re.compile(r"\w+(\.\w+)*:\w+(\.\w+)*")  # of "package.module:attribute"
GROUP = "sprl_bench.agents"
SET_BY_THE_RUN = ("seed", "device", "self")  # no hyperparameters
NUM_ENVS = 12  # for an agent that does not name it
NAMED = (inspect.Parameter.KEYWORD_ONLY, inspect.Parameter.POSITIONAL_OR_KEYWORD)

Policy = Callable[[Any], Any]
"""Takes an observation of a single environment and returns an action for it."""


class Agent(Protocol):
    """An agent owns its training loop."""

    def train(self, envs: VectorEnv[Any, Any, Any], budget: int) -> Iterator[Mapping[str, float]]:
        """Train in `envs`, which are already seeded, and yield metrics after each update.

        The harness stops the loop once `budget` environment steps are taken; a schedule may rely on that number. The
        harness writes the metrics `env_steps`, `wall_time_s`, `return` and `success` itself: an agent's of these names
        are left out.
        """
        ...


@runtime_checkable
class Resumable(Protocol):
    """An agent whose run can be interrupted between two updates and continued as if it had not been."""

    def state_dict(self) -> Mapping[str, Any]:
        """Return nested mappings of tensors, arrays, numbers, strings and None: all that training depends on."""
        ...

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Take such a state; `train` then continues from it without resetting the environments."""
        ...


@runtime_checkable
class Playable(Resumable, Protocol):
    """An agent that can act with what it has learned, outside training."""

    def weights(self) -> Mapping[str, Any]:
        """Return the part of the state that acting needs; it is written when a run is finished."""
        ...

    def policy(self, observation_space: Space[Any], action_space: Space[Any], seed: int) -> Policy:
        """Return the policy for what `load_state_dict` was given: a whole state, or the weights alone.

        Args:
            observation_space: That of a single environment.
            action_space: That of a single environment.
            seed: Source of every random choice.
        """
        ...


class AgentFactory(Protocol):
    """Makes an agent from keyword arguments.

    Six attributes are optional:

    - `privileged` (bool, default False): whether the agent sees more than an ordinary one;
    - `information` (names, default none): what else it uses: "relabelling", "resetting", "shaped";
    - `hyperparameters(domain, overrides)`, with a third argument `preset` if the agent has presets: returns all
      hyperparameters; without it they are the factory's keyword arguments and their defaults;
    - `default_preset` (text): the preset that the agent's plain name means;
    - `ranges(domain)`: returns the values of hyperparameters that `sprl-bench sweep --range table` tries;
    - `wait(hyperparameters)`: returns the env steps before which what the agent adds is not in use, so that a run with
      a smaller budget can be told that it says nothing about it.
    """

    def __call__(self, *, seed: int, device: str = "cpu", **hyperparameters: Any) -> Agent:
        """Return an agent; all its random choices depend on `seed` alone."""
        ...


def agent_names() -> list[str]:
    """Return the names of all installed agents."""
    return sorted({entry.name for entry in entry_points(group=GROUP)})


def load_factory(name: str) -> AgentFactory:
    """Return the factory behind an installed agent's name or "package.module:attribute".

    Raises:
        ValueError: Nothing is installed under that name, or the attribute is not callable.
        ModuleNotFoundError: The module, or something that it needs, is not installed.
    """
    target = name if ":" in name else _installed(name)
    found = load_attribute(target)
    if not callable(found):
        what = "there is no such thing in it" if found is None else "it is not callable"
        raise ValueError(f"agent is {name!r}; it must name a factory in {target.partition(':')[0]}, and {what}.")
    factory: AgentFactory = found
    return factory


def load_attribute(target: str) -> Any:
    """Return the value of "module:attribute", or None if the module has no such attribute.

    Raises:
        ValueError: It is not of that form.
    """
    module, _, attribute = target.partition(":")
    if module.endswith(".py") and FORM.fullmatch(target):
        raise ValueError(f"code is named {target!r}; it must be a module, not a file: {module[:-3]}:{attribute}.")
    if not FORM.fullmatch(target):
        raise ValueError(f"code is named {target!r}; it must be package.module:attribute, each a Python name.")
    found = _module(module)
    for part in attribute.split("."):
        found = getattr(found, part, None)
    return found


def _module(name: str) -> Any:
    """Import a module that the user named."""
    try:
        return importlib.import_module(name)
    except ModuleNotFoundError as error:
        if error.name is None or not f"{name}.".startswith(f"{error.name}."):
            raise  # something that the module needs
        raise ModuleNotFoundError(
            f"No module named {error.name!r}, neither here nor installed; run the command in the module's folder.",
            name=error.name,
        ) from None
    except (ImportError, SyntaxError):
        raise  # says what and where
    except Exception as error:  # whatever the user's code raises
        place = traceback.extract_tb(error.__traceback__)[-1]
        fault = f"{type(error).__name__}: {error}"
        raise ImportError(f"{name} cannot be imported: {place.filename}:{place.lineno}: {fault}", name=name) from error


def _installed(name: str) -> str:
    found = {entry.name: entry.value for entry in entry_points(group=GROUP)}
    if name not in found:
        raise ValueError(unknown("agent", name, found) + " Name your own as package.module:factory.")
    return found[name]


@dataclass(frozen=True)
class Hyperparameters:
    """All hyperparameters of a run, resolved and checked.

    Attributes:
        values: What the factory will be called with.
        num_envs: The number of sub-environments: the hyperparameter of that name, or 12 for an agent that has none.
        differences: Those of the values that differ from the preset; `num_envs` may be among them.
    """

    values: Mapping[str, Any]
    num_envs: int
    differences: Mapping[str, Any]


def resolve_hyperparameters(
    factory: AgentFactory, domain: str, overrides: Mapping[str, Any], preset: str = ""
) -> Hyperparameters:
    """Resolve and check all hyperparameters of a run, once.

    Args:
        factory: The agent's.
        domain: Of the task, such as "grid".
        overrides: What differs from the preset. `num_envs` may always be among them.
        preset: The name of a preset, or empty for the domain's own.

    Raises:
        ValueError: There is no such preset or hyperparameter, a value is out of range, or one without a default is
            missing.
    """
    if "preset" in overrides:
        preset = overrides["preset"]
        raise ValueError(f"preset is {preset!r}; it must be named behind the agent, as in AGENT@{preset}.")
    known = _resolve(factory, domain, {}, preset)
    given, others = dict(overrides), {}
    if "num_envs" not in known:
        known["num_envs"] = NUM_ENVS
        others["num_envs"] = given.pop("num_envs", NUM_ENVS)
    resolved = _resolve(factory, domain, given, preset)
    missing = [name for name, value in resolved.items() if value is inspect.Parameter.empty]
    if missing:
        raise ValueError(f"Hyperparameters of the agent without a default must be given: {', '.join(missing)}.")
    chosen = {**resolved, **others}
    differences = {name: value for name, value in chosen.items() if name not in known or value != known[name]}
    return Hyperparameters(resolved, chosen["num_envs"], differences)


def _resolve(factory: AgentFactory, domain: str, overrides: Mapping[str, Any], preset: str) -> dict[str, Any]:
    """Ask the factory or read its signature; a missing value is `Parameter.empty`."""
    resolve = getattr(factory, "hyperparameters", None)
    if preset and (resolve is None or "preset" not in inspect.signature(resolve).parameters):
        raise ValueError(f"preset is {preset!r}; it must be left out, as this agent has no presets.")
    if resolve is not None:
        found: Any = resolve(domain, overrides, **({"preset": preset} if preset else {}))
        if not isinstance(found, Mapping):
            raise ValueError(f"hyperparameters() of the agent returned {found!r:.80}; it must return a mapping.")
        return dict(found)
    parameters = [one for one in inspect.signature(factory).parameters.values() if one.name not in SET_BY_THE_RUN]
    known = {one.name: one.default for one in parameters if one.kind in NAMED}
    takes_any = any(one.kind is inspect.Parameter.VAR_KEYWORD for one in parameters)
    for name in overrides:
        if name in SET_BY_THE_RUN or (name not in known and not takes_any):
            raise ValueError(unknown("hyperparameter", name, known))
    return {**known, **overrides}
