"""What an agent is, and how a name becomes one.

An agent owns its training loop and yields a few metrics after each update; the harness owns the clock, the progress
bar, the checkpoint and the budget. Nothing here knows how any agent works.
"""

from __future__ import annotations

import importlib
import inspect
from collections.abc import Callable, Iterator, Mapping
from importlib.metadata import entry_points
from typing import Any, Protocol, runtime_checkable

from gymnasium.vector import VectorEnv

from sprl_bench.suggestions import unknown

__all__ = ["Agent", "AgentFactory", "Resumable", "agent_names", "load_factory", "resolve_hyperparameters"]

GROUP = "sprl_bench.agents"


class Agent(Protocol):
    """Anything that trains."""

    def train(self, envs: VectorEnv[Any, Any, Any], budget: int) -> Iterator[Mapping[str, float]]:
        """Train in `envs`, which arrive seeded, and yield metrics after each update.

        The harness stops asking once `budget` environment steps are taken; a schedule may rely on that number.
        """
        ...


@runtime_checkable
class Resumable(Protocol):
    """An agent whose run can be interrupted between two updates and continued as if it had not been."""

    def state_dict(self) -> Mapping[str, Any]:
        """Return nested mappings of tensors, arrays, numbers, strings and None: all that training depends on."""
        ...

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Take such a state; `train` then goes on from it without resetting the environments."""
        ...


class AgentFactory(Protocol):
    """Makes an agent from keyword arguments.

    Two attributes are optional: `privileged` (bool, default False) says that the agent sees what an ordinary one
    does not; `hyperparameters(domain, overrides)` resolves presets. Without the latter the hyperparameters are the
    factory's own keyword arguments and their defaults.
    """

    def __call__(self, *, seed: int, device: str = "cpu", **hyperparameters: Any) -> Agent:
        """Return an agent whose every random choice follows from `seed`."""
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
    module, _, attribute = target.partition(":")
    factory: Any = importlib.import_module(module)
    for part in attribute.split("."):
        factory = getattr(factory, part, None)
    if not callable(factory):
        raise ValueError(f"Agent {name!r}: {target!r} is not a callable factory.")
    made: AgentFactory = factory
    return made


def _installed(name: str) -> str:
    found = {entry.name: entry.value for entry in entry_points(group=GROUP)}
    if name not in found:
        raise ValueError(unknown("agent", name, found) + " An agent of your own is named as package.module:factory.")
    return found[name]


def resolve_hyperparameters(factory: AgentFactory, domain: str, overrides: Mapping[str, Any]) -> dict[str, Any]:
    """Return the full set of hyperparameters that `factory` will be called with in `domain`.

    Raises:
        ValueError: An override has an unknown name or a value out of range.
    """
    resolve: Callable[..., dict[str, Any]] = getattr(factory, "hyperparameters", None) or _from_signature(factory)
    return dict(resolve(domain, dict(overrides)))


def _from_signature(factory: AgentFactory) -> Callable[..., dict[str, Any]]:
    parameters = [
        parameter
        for parameter in inspect.signature(factory).parameters.values()
        if parameter.name not in ("seed", "device", "self")
    ]
    takes_any = any(parameter.kind is inspect.Parameter.VAR_KEYWORD for parameter in parameters)
    defaults = {
        parameter.name: parameter.default
        for parameter in parameters
        if parameter.kind in (inspect.Parameter.KEYWORD_ONLY, inspect.Parameter.POSITIONAL_OR_KEYWORD)
        and parameter.default is not inspect.Parameter.empty
    }

    def resolve(_domain: str, overrides: dict[str, Any]) -> dict[str, Any]:
        for name in overrides:
            if name not in defaults and not takes_any:
                raise ValueError(unknown("hyperparameter", name, defaults))
        return {**defaults, **overrides}

    return resolve
