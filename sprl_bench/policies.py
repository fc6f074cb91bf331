"""The policy of a video: from its name to a function from one observation to one action.

A policy is `random`, `still`, the exact `solver` of grids and mazes, a function of your own, or the trained agent of a
run, which gives its own policy (`sprl_bench.agents.Playable`).
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType
from typing import Any, Final

import gymnasium
import numpy as np
from gymnasium import spaces

from sprl_bench import checkpoint
from sprl_bench.agents import Playable, Policy, load_attribute, load_factory
from sprl_bench.envs import GRID_IDS, MAZE_IDS
from sprl_bench.naming import AgentName
from sprl_bench.records import RunSpec, read
from sprl_bench.records.files import printable
from sprl_bench.records.folder import CHECKPOINT, RECORD, SPEC, WEIGHTS, find_files
from sprl_bench.suggestions import unknown
from sprl_bench.tasks import Argument

Env = gymnasium.Env[Any, Any]

MANY_RUNS: Final = 5  # in one message
SHOWN_LETTERS: Final = 200  # of an error


class PolicyError(ValueError):
    """A function that is no policy: it raised an error, or returned no action."""


class UnplayableRunError(ValueError):
    """A run whose agent cannot act."""


@dataclass(frozen=True)
class Actor:
    """A policy before it has an environment."""

    begin: Callable[[Env, int], Policy]  # from an environment and a seed
    arguments: Mapping[str, Argument] = field(default_factory=lambda: MappingProxyType({}))  # of its training


def find_actor(name: str | Path | Policy, agent: str | None = None) -> Actor:
    """Return the actor of a name.

    Args:
        name: `random`, `still`, `solver`, "package.module:function", a run's folder, or a function from an observation
            to an action.
        agent: The "package.module:factory" of a run's agent, unless it is an installed one: no code is loaded because
            a file names it.

    Raises:
        ValueError: There is no such policy.
        ModuleNotFoundError: The module, or something that it needs, is not installed.
        UnplayableRunError: The folder is a run's, but its agent cannot act, or has to be named.
    """
    if isinstance(name, Path):
        name = str(name)
    if not isinstance(name, str):
        return _given(name, name)
    if (Path(name) / SPEC).is_file() and name not in _NAMED:
        return _trained(Path(name), agent)
    if agent is not None:
        raise ValueError(f"agent is {agent!r}; it must be left out, as policy {name!r} is not the folder of a run.")
    if name in _NAMED:
        return Actor(_NAMED[name])
    if ":" in name:
        return _given(name, load_attribute(name))
    raise ValueError(
        unknown("policy", name, NAMES) + " Name your own as package.module:function, and a run by its folder."
    )


def _given(name: object, policy: Policy) -> Actor:
    if not callable(policy):
        raise ValueError(f"policy is {name!r}; it must be a name, a run's folder, or a function of an observation.")
    return Actor(lambda env, _seed: _checked(name, policy, env.action_space))


def _checked(name: object, policy: Policy, space: spaces.Space[Any]) -> Policy:
    """Return a policy of which an error, or what is no action, is named."""

    def act(observation: Any) -> Any:
        try:
            action = policy(observation)
        except Exception as error:
            raise PolicyError(f"policy is {name!r}; it raised {type(error).__name__}: {error}") from error
        if not _is_action(action, space):
            raise PolicyError(f"policy is {name!r}; it must return an action of {space}, not {action!r:.80}.")
        return action

    return act


def _is_action(action: Any, space: spaces.Space[Any]) -> bool:
    """Return whether an environment would take it: numbers of the right shape, whatever their type."""
    if isinstance(space, spaces.Box):
        return np.shape(action) == space.shape and np.issubdtype(np.asarray(action).dtype, np.number)
    return bool(space.contains(action) or space.contains(getattr(action, "item", lambda: None)()))


def _random(env: Env, seed: int) -> Policy:
    """Draw each action uniformly."""
    env.action_space.seed(seed)
    return lambda _observation: env.action_space.sample()


def _still(env: Env, _seed: int) -> Policy:
    """Do nothing: no displacement, the grids' "done", or the mazes' "fire"."""
    space = env.action_space
    if isinstance(space, spaces.Box):
        zeros = np.clip(np.zeros(space.shape, space.dtype), space.low, space.high)
        return lambda _observation: zeros
    if _id_of(env) in MAZE_IDS:
        return _firing(env)
    _require_grid(env, "still", (*GRID_IDS, *MAZE_IDS))
    from sprl_bench.envs.grid.encoding import DONE  # noqa: PLC0415 - loads numba

    return lambda _observation: DONE


def _firing(env: Env) -> Policy:
    from sprl_bench.envs.maze.levels import FIRE  # noqa: PLC0415 - loads numba

    if not env.action_space.contains(FIRE):
        raise ValueError("fire is False; it must be True for the policy 'still', because every other action moves.")
    return lambda _observation: FIRE


def _solver(env: Env, _seed: int) -> Policy:
    """Follow a shortest path."""
    if _id_of(env) in MAZE_IDS:
        return _walking(env)
    _require_grid(env, "solver", (*GRID_IDS, *MAZE_IDS))
    from sprl_bench.solver import optimal_actions  # noqa: PLC0415 - loads numba

    return lambda observation: int(optimal_actions(observation[None])[0])


def _walking(env: Env) -> Policy:
    """Follow a shortest path through a maze, which a picture does not show."""
    from sprl_bench.solver import maze_actions  # noqa: PLC0415 - loads numba

    mazes: Any = env.unwrapped
    return lambda _observation: int(maze_actions(mazes.mazes)[0])


def _id_of(env: Env) -> str:
    return env.spec.id if env.spec else str(env)


def _require_grid(env: Env, policy: str, allowed: tuple[str, ...]) -> None:
    if _id_of(env) not in GRID_IDS:
        raise ValueError(f"There is no policy {policy!r} for {_id_of(env)}; it is for {', '.join(allowed)}.")


_NAMED: Mapping[str, Callable[[Env, int], Policy]] = MappingProxyType(
    {"random": _random, "solver": _solver, "still": _still}
)
NAMES: Final = tuple(_NAMED)


def find_run(root: Path, env_id: str, agent: str | None = None) -> Path:
    """Return the folder, `root` or below it, of the only run in this environment, of this agent if one is named.

    The agent is named as in tables, or as "package.module:factory", which a preset and differences may follow.

    Raises:
        ValueError: There are several.
        FileNotFoundError: There is none; recorded scripts do not count.
        InvalidFileError: The spec of a run there is broken.
    """
    specs = {path.parent: read(path, RunSpec) for path in find_files(root, SPEC)}
    folders = [
        folder
        for folder, spec in specs.items()
        if spec.task.env_id == env_id and (agent is None or _is_agent_of(spec, agent))
    ]
    wanted = f"run of {agent} in {env_id}" if agent else f"run in {env_id}"
    if not folders:
        hint = " Recorded scripts do not count: they keep no agent." if _holds_scripts(root) else ""
        raise FileNotFoundError(f"{root} holds no {wanted}.{hint}")
    if len(folders) > 1:
        names = [*map(str, folders[:MANY_RUNS]), *(["..."] if len(folders) > MANY_RUNS else [])]
        raise ValueError(f"{root} holds more than one {wanted}; name one of them: {', '.join(names)}")
    return folders[0]


def _is_agent_of(spec: RunSpec, agent: str) -> bool:
    """Return whether a run's agent is named so: as in tables, or as its code, which the rest of its name may follow."""
    if ":" not in agent:
        return agent == spec.agent
    name = AgentName.parse(agent)
    return name.source == spec.source and (agent == spec.source or str(name) == spec.agent)


def _holds_scripts(root: Path) -> bool:
    """Return whether there are records, but only of scripts."""
    return not find_files(root, SPEC) and bool(find_files(root, RECORD))


def _trained(folder: Path, agent: str | None) -> Actor:
    """Return the agent of a run, as at its end or, if unfinished, at its last checkpoint."""
    spec = read(folder / SPEC, RunSpec)
    if ":" in spec.source and not (agent and ":" in agent and _is_agent_of(spec, agent)):
        raise UnplayableRunError(
            f"The agent of {folder} is {spec.source!r}: your own code is loaded only if you name it, as "
            f"--agent {spec.source} or agent={spec.source!r}."
        )
    if agent not in (None, spec.source) and not _is_agent_of(spec, agent):
        raise ValueError(f"agent is {agent!r}, but {folder} is a run of {spec.agent!r}.")
    _saved(folder, spec)

    def begin(env: Env, seed: int) -> Policy:
        if env.spec is None or env.spec.id != spec.task.env_id:
            raise ValueError(f"{folder} is a run in {spec.task.env_id}, not in {env.spec and env.spec.id}.")
        agent = restore(folder, spec)
        with _fitting(_saved(folder, spec), spec):
            return agent.policy(env.observation_space, env.action_space, seed)

    return Actor(begin, spec.task.arguments)


def _saved(folder: Path, spec: RunSpec) -> Path:
    saved = [folder / name for name in (CHECKPOINT, WEIGHTS) if (folder / name).exists()]
    if not saved:
        raise UnplayableRunError(
            f"{folder} has no trained agent {spec.agent!r}: it must hold {WEIGHTS}, which a finished run of an agent "
            f"with a policy() leaves, or {CHECKPOINT}."
        )
    return saved[0]


def restore(folder: Path, spec: RunSpec) -> Playable:
    """Return the agent of a run, as at its end or, if unfinished, at its last checkpoint.

    Raises:
        UnplayableRunError: The run keeps no agent, or one that cannot act.
    """
    file = _saved(folder, spec)
    factory = load_factory(spec.source or spec.agent)
    agent = factory(seed=spec.seed, device="cpu", **spec.hyperparameters)
    if not isinstance(agent, Playable):
        raise UnplayableRunError(f"Agent {spec.agent!r} cannot act: it has no method policy().")
    saved = checkpoint.load(file)
    with _fitting(file, spec):
        agent.load_state_dict(saved["agent"])
    return agent


@contextlib.contextmanager
def _fitting(file: Path, spec: RunSpec) -> Iterator[None]:
    """Name the file whose content an agent does not take, whatever it raises.

    Raises:
        UnplayableRunError: It raises something.
    """
    try:
        yield
    except Exception as error:
        text = printable(f"{type(error).__name__}: {error}", SHOWN_LETTERS)
        raise UnplayableRunError(f"{file} does not fit the agent {spec.agent!r} ({text}).") from error
