"""NAVIX's FourRooms at our size, compiled by JAX; runs in an environment of its own, as it needs Python 3.12.

A turn is one compiled loop: it draws uniformly random actions, steps all environments, and keeps every whole symbolic
observation, reward and ending. NAVIX restarts an environment in the step after its end; that step counts.
"""

from __future__ import annotations

import itertools
from typing import Any

from benchmarks.jax_cores import limit_jax
from benchmarks.turns import Turn

TASK, MAX_STEPS = "Navix-FourRooms-7x7-v0", 100


def random_steps(num_envs: int, steps: int) -> Turn:
    """Return turns of so many vector steps on one core."""
    limit_jax(1)
    import jax  # noqa: PLC0415 - after its limit
    import navix  # noqa: PLC0415 - imports JAX

    envs = navix.make(TASK, observation_fn=navix.observations.symbolic, max_steps=MAX_STEPS)

    def step(timestep: Any, actions: Any) -> tuple[Any, Any]:
        timestep = jax.vmap(envs.step)(timestep, actions)
        return timestep, (timestep.observation, timestep.reward, timestep.step_type)

    def play(timestep: Any, key: Any) -> Any:
        return jax.lax.scan(step, timestep, jax.random.randint(key, (steps, num_envs), 0, len(envs.action_set)))

    compiled = jax.jit(play)
    timestep = jax.jit(jax.vmap(envs.reset))(jax.random.split(jax.random.PRNGKey(0), num_envs))
    counter = itertools.count()

    def turn() -> int:
        nonlocal timestep
        timestep, _ = jax.block_until_ready(compiled(timestep, jax.random.PRNGKey(next(counter))))
        return steps * num_envs

    turn()  # compiles for what a reset returns; what a step returns has other types, and is compiled for next
    return turn
