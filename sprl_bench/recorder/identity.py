"""Which task an environment is, by its id and arguments, with no wrapper beneath the recorder that could change it.

Only the wrappers that `gymnasium.make` adds itself may lie beneath. All others belong above the recorder, where they
cannot change a score.
"""

from __future__ import annotations

import inspect
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Final

import gymnasium
import numpy as np
from gymnasium import wrappers
from gymnasium.envs.registration import EnvSpec, load_env_creator
from gymnasium.vector import AsyncVectorEnv, SyncVectorEnv, VectorEnv, VectorWrapper

from sprl_bench.records.types import LIMIT
from sprl_bench.tasks import CUSTOM, SUITES, Argument, Suite, Task, find_suite, match_task, with_budget

NAMESPACE: Final = "SPRL/"  # of our own environments

Env = gymnasium.Env[Any, Any]
Envs = VectorEnv[Any, Any, Any]

HARMLESS: Final = (
    wrappers.PassiveEnvChecker,
    wrappers.OrderEnforcing,
    wrappers.HumanRendering,
    wrappers.RenderCollection,
)
# Arguments that change no episode, only how it is made or shown: those of Gymnasium, and of our environments.
OF_MAKING: Final = frozenset(
    ("render_mode", "num_envs", "vectorization_mode", "vector_kwargs", "wrappers", "max_episode_steps")
)
OF_SHOWING: Final = frozenset(("autoreset_mode", "num_threads", "copy", "observation"))
PLAIN: Final = bool | int | float | str
ADVICE: Final = "record what gymnasium.make returned, and wrap what record() returns."


@dataclass(frozen=True)
class Identity:
    """An environment's id and arguments.

    Attributes:
        env_id: The Gymnasium id.
        arguments: Those given to `make` that can change an episode.
        defaults: Of the arguments that were not given.
        observation: The form in which our own environment is seen, which does not change its task; empty for the
            usual one.
    """

    env_id: str
    arguments: Mapping[str, Argument]
    defaults: Mapping[str, Argument]
    observation: str = ""


def identify(env: Env | Envs) -> Identity:
    """Return the id and arguments of a single or a vector environment.

    Raises:
        TypeError: It is neither.
        ValueError: It was not made by `gymnasium.make` or `make_vec`, or a wrapper on it could change rewards or ends.
    """
    if isinstance(env, VectorWrapper):
        raise ValueError(f"{type(env).__name__} lies beneath the recorder; {ADVICE}")
    if isinstance(env, VectorEnv) and "autoreset_mode" not in env.metadata:
        raise ValueError(f"{env} does not say when it resets: metadata['autoreset_mode'] is missing.")
    if isinstance(env, SyncVectorEnv):
        return _common([_identify_single(single) for single in env.envs])
    if isinstance(env, AsyncVectorEnv):
        return _common([_identify_by_spec(spec) for spec in env.get_attr("spec")])
    if isinstance(env, VectorEnv):
        return _identify_by_spec(env.spec)
    if isinstance(env, gymnasium.Env):
        return _identify_single(env)
    raise TypeError(
        f"env is a {type(env).__module__}.{type(env).__qualname__}; record() takes a gymnasium.Env or a "
        "gymnasium.vector.VectorEnv. Where another library makes its own kind of vector environment, record each "
        "environment inside."
    )


def _common(identities: list[Identity]) -> Identity:
    for other in identities:
        if other != identities[0]:
            raise ValueError(
                f"The sub-environments are not all the same: {identities[0].env_id} {dict(identities[0].arguments)} "
                f"and {other.env_id} {dict(other.arguments)}."
            )
    return identities[0]


def _identify_single(env: Env) -> Identity:
    made = env.unwrapped.spec
    registered = _registered(made)
    layer: Env = env
    while isinstance(layer, gymnasium.Wrapper):
        _check_wrapper(layer, registered)
        layer = layer.env
    return _identity(registered, made.kwargs if made else {})


def _check_wrapper(layer: gymnasium.Wrapper[Any, Any, Any, Any], registered: EnvSpec) -> None:
    kind = type(layer)
    if kind in HARMLESS:
        return
    if kind is wrappers.TimeLimit:
        _check_time_limit(layer.get_wrapper_attr("_max_episode_steps"), registered)
        return
    if f"{kind.__module__}:{kind.__name__}" not in [wrapper.entry_point for wrapper in registered.additional_wrappers]:
        raise ValueError(f"{kind.__name__} lies beneath the recorder; {ADVICE}")


def _check_time_limit(limit: int | None, registered: EnvSpec) -> None:
    if limit not in (None, -1, registered.max_episode_steps):
        raise ValueError(
            f"max_episode_steps={limit} changes where episodes of {registered.id} end; it is "
            f"{registered.max_episode_steps} there. Leave it out. A TimeLimit may lie above the recorder; the episodes "
            "that it cuts count as failures."
        )


def _identify_by_spec(made: EnvSpec | None) -> Identity:
    """Identify an environment of other processes or a batched one: its spec lists all wrappers and arguments."""
    registered = _registered(made)
    assert made is not None
    own = [wrapper.entry_point for wrapper in registered.additional_wrappers]
    names = [wrapper.name for wrapper in made.additional_wrappers if wrapper.entry_point not in own]
    names += [getattr(wrapper, "__name__", repr(wrapper)) for wrapper in made.kwargs.get("wrappers", ())]
    if names:
        raise ValueError(f"{names[0]} lies beneath the recorder; {ADVICE}")
    _check_time_limit(made.max_episode_steps, registered)
    _check_time_limit(made.kwargs.get("max_episode_steps"), registered)
    return _identity(registered, made.kwargs)


def _registered(made: EnvSpec | None) -> EnvSpec:
    if made is None or made.id not in gymnasium.registry:
        raise ValueError("The environment has no registered id: make it by gymnasium.make or gymnasium.make_vec.")
    return gymnasium.registry[made.id]


def _identity(registered: EnvSpec, arguments: Mapping[str, Any]) -> Identity:
    ours = registered.id.startswith(NAMESPACE)
    without = OF_MAKING | OF_SHOWING if ours else OF_MAKING
    own = {**_signature(registered), **registered.kwargs}
    form = arguments.get("observation", "") if ours else ""
    given = {
        name: value.item() if isinstance(value, np.generic) else value
        for name, value in arguments.items()
        if name not in without and not (name in own and _is_same(own[name], value))
    }
    defaults = {
        **_defaults(registered),
        **{name: value for name, value in registered.kwargs.items() if isinstance(value, PLAIN)},
    }
    defaults = {name: value for name, value in defaults.items() if name not in without}
    return Identity(registered.id, given, defaults, "" if form == own.get("observation") else str(form))


def _is_same(default: Any, value: Any) -> bool:
    """Return whether a value is the default; a list, an array or None may be one."""
    return value is default or (type(value) is type(default) and bool(np.all(np.asarray(value == default))))


def _defaults(registered: EnvSpec) -> dict[str, Argument]:
    """Return the plain defaults in the signature of a single environment's constructor."""
    return {name: value for name, value in _signature(registered).items() if isinstance(value, PLAIN)}


def _signature(registered: EnvSpec) -> dict[str, Any]:
    """Return the defaults in the signature of a single environment's constructor."""
    entry_point = registered.entry_point
    creator: Callable[..., Any] | None = load_env_creator(entry_point) if isinstance(entry_point, str) else entry_point
    if creator is None:
        return {}
    parameters = inspect.signature(creator).parameters
    return {name: p.default for name, p in parameters.items() if p.default is not inspect.Parameter.empty}


def choose_task(
    identity: Identity, suite: str | None, budget: int | None, score_range: tuple[float, float] | None = None
) -> tuple[Suite, Task]:
    """Return the suite and task that a recorded environment belongs to.

    Args:
        identity: The environment.
        suite: Its name; by default the first suite that holds the environment.
        budget: Environment steps; a budget other than the task's makes the run "custom".
        score_range: Lowest and highest return of a task of no suite; by default (0, 1).

    Raises:
        ValueError: There is no such suite, it has no such task, no task matches and no budget is given, or a task of a
            suite is given another score range.
    """
    if budget is not None and (isinstance(budget, bool) or not isinstance(budget, int | np.integer) or budget < 1):
        raise ValueError(f"budget is {budget!r}; it must be a positive integer, in environment steps.")
    named = suite not in (None, CUSTOM.name)
    suites = [find_suite(str(suite))] if named else list(SUITES.values())
    found = match_task(identity.env_id, identity.arguments, identity.defaults, suites)
    if named and found is None:
        tasks = ", ".join(task.name for task in suites[0].tasks)
        raise ValueError(f"suite {suite!r} has no task {_described(identity)}; its tasks are {tasks}.")
    given_range = None if score_range is None else _checked_range(score_range)
    if found is not None and given_range not in (None, found[1].score_range):
        raise ValueError(f"score_range is {score_range!r}; it must be that of {found[1].name}, {found[1].score_range}.")
    if found is not None and suite != CUSTOM.name and budget in (None, found[1].budget):
        return found
    if budget is None:
        raise ValueError(f"No suite has a task {_described(identity)}: give budget=..., in environment steps.")
    task = found[1] if found else _task_of_its_own(identity, given_range or (0.0, 1.0))
    return CUSTOM, with_budget(task, int(budget))


def _checked_range(score_range: Any) -> tuple[float, float]:
    try:
        low, high = (float(end) for end in score_range)
    except (TypeError, ValueError):
        low = high = math.nan
    if not low < high:
        raise ValueError(f"score_range is {score_range!r}; it must be two numbers, the lowest and the highest return.")
    return low, high


def _described(identity: Identity) -> str:
    arguments = "".join(f", {name}={value!r}" for name, value in identity.arguments.items())
    return f"{identity.env_id}{arguments}"


def _check_argument(env_id: str, name: str, value: object) -> None:
    """Refuse an argument that a record cannot hold, and so nobody could compare.

    Raises:
        ValueError: It is neither text nor a number nor a boolean, or too large.
    """
    plain = isinstance(value, PLAIN) and not (isinstance(value, int) and abs(value) >= LIMIT)
    if not plain or (isinstance(value, float) and not math.isfinite(value)):
        raise ValueError(
            f"{name} is {value!r:.80}; as an argument of {env_id} in a record it must be text, a boolean or a finite "
            f"number below 2^53. Register an id of your own for an environment with other arguments."
        )


def _task_of_its_own(identity: Identity, score_range: tuple[float, float]) -> Task:
    """Return a task of no suite, with its arguments in its name."""
    domains = [task.domain for suite in SUITES.values() for task in suite.tasks if task.env_id == identity.env_id]
    defaults = identity.defaults
    changed = {name: v for name, v in identity.arguments.items() if name not in defaults or defaults[name] != v}
    for name, value in changed.items():
        _check_argument(identity.env_id, name, value)
    name = "-".join([identity.env_id.rpartition("/")[2], *(f"{name}-{v}" for name, v in sorted(changed.items()))])
    return Task(
        name=name,
        env_id=identity.env_id,
        budget=1,
        domain=domains[0] if domains else CUSTOM.name,
        arguments=changed,
        score_range=score_range,
    )
