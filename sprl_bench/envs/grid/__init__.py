"""The grid tasks: layouts (pure functions), the single environment on Minigrid, and the batched engine."""
