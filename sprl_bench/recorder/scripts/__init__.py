"""Records of any script's run: one line around its environment, or one block around all of it.

Environments recorded under the same suite, task, agent and seed in one process are the sub-environments of one run, as
where a library makes its vector environment out of single ones. They must be stepped in turn. An environment that is
used for something else, such as evaluation, is therefore noticed at once, and must be made outside.
"""

from __future__ import annotations

from sprl_bench.recorder.scripts.block import Recording, recording
from sprl_bench.recorder.scripts.line import record

__all__ = ["Recording", "record", "recording"]
