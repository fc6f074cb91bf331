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

from gymnasium import Space
from gymnasium.vector import VectorEnv

from sprl_bench.suggestions import unknown

GROUP = "sprl_bench.agents"
SET_BY_THE_RUN = ("seed", "device")  # what every factory is given, so no hyperparameter

Policy = Callable[[Any], Any]
"""Takes an observation of a single environment and returns an action for it."""


class Agent(Protocol):
    """Anything that trains."""

    def train(self, envs: VectorEnv[Any, Any, Any], budget: int) -> Iterator[Mapping[str, float]]:
        """Train in `envs`, which arrive seeded, and yield metrics after each update.

        The harness stops asking once `budget` environment steps are taken; a schedule may rely on that number. Metrics
        called `env_steps` and `wall_time_s` are the harness's own: an agent's of that name are left out.
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


@runtime_checkable
class Playable(Resumable, Protocol):
    """An agent that can show what it has learned, apart from training."""

    def weights(self) -> Mapping[str, Any]:
        """Return the part of the state that acting needs; a finished run keeps it."""
        ...

    def policy(self, observation_space: Space[Any], action_space: Space[Any], seed: int) -> Policy:
        """Return how the agent acts with what `load_state_dict` was given, a whole state or the weights alone.

        Args:
            observation_space: That of a single environment.
            action_space: That of a single environment.
            seed: Source of every random choice.
        """
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
    factory: AgentFactory = load_attribute(target)
    if not callable(factory):
        raise ValueError(f"Agent {name!r}: {target!r} is not a callable factory.")
    return factory


def load_attribute(target: str) -> Any:
    """Return what "module:attribute" names, or None where the module has no such attribute."""
    module, _, attribute = target.partition(":")
    found: Any = importlib.import_module(module)
    for part in attribute.split("."):
        found = getattr(found, part, None)
    return found


def _installed(name: str) -> str:
    found = {entry.name: entry.value for entry in entry_points(group=GROUP)}
    if name not in found:
        raise ValueError(unknown("agent", name, found) + " An agent of your own is named as package.module:factory.")
    return found[name]


def resolve_hyperparameters(factory: AgentFactory, domain: str, overrides: Mapping[str, Any]) -> dict[str, Any]:
    """Return the full set of hyperparameters that `factory` will be called with in `domain`.

    Raises:
        ValueError: An override has an unknown name or a value out of range, or one without a default is not given.
    """
    resolve: Callable[..., dict[str, Any]] = getattr(factory, "hyperparameters", None) or _from_signature(factory)
    return dict(resolve(domain, dict(overrides)))


def has_hyperparameter(factory: AgentFactory, domain: str, name: str) -> bool:
    """Return whether `factory` names such a hyperparameter in `domain`, with a default or without."""
    resolve = getattr(factory, "hyperparameters", None)
    return name in (resolve(domain, {}) if resolve else _keywords(factory))


def _keywords(factory: AgentFactory) -> dict[str, Any]:
    """Return the hyperparameters in a signature with their defaults, `Parameter.empty` where there is none."""
    return {
        parameter.name: parameter.default
        for parameter in inspect.signature(factory).parameters.values()
        if parameter.name not in (*SET_BY_THE_RUN, "self")
        and parameter.kind in (inspect.Parameter.KEYWORD_ONLY, inspect.Parameter.POSITIONAL_OR_KEYWORD)
    }


def _from_signature(factory: AgentFactory) -> Callable[..., dict[str, Any]]:
    known = _keywords(factory)
    kinds = {parameter.kind for parameter in inspect.signature(factory).parameters.values()}
    takes_any = inspect.Parameter.VAR_KEYWORD in kinds

    def resolve(_domain: str, overrides: dict[str, Any]) -> dict[str, Any]:
        """Return the defaults in the signature under the overrides, whatever the domain."""
        for name in overrides:
            if name in SET_BY_THE_RUN or (name not in known and not takes_any):
                raise ValueError(unknown("hyperparameter", name, known))
        resolved = {**known, **overrides}
        missing = [name for name, value in resolved.items() if value is inspect.Parameter.empty]
        if missing:
            raise ValueError(f"The agent's hyperparameters without a default must be given: {', '.join(missing)}.")
        return resolved

    return resolve
