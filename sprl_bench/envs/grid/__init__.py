"""The grid tasks: layouts (pure), the single environment on Minigrid, and the batched engine."""
