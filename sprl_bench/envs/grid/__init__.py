"""The grid tasks: layouts (pure functions), the single environment on Minigrid, and the batched engine."""

from sprl_bench.envs.grid.encoding import Action

__all__ = ["Action"]
