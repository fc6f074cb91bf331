"""The six Atari games of appendix F, single and batched, on ale-py's vector environment."""

from __future__ import annotations

from importlib.util import find_spec

from sprl_bench.extras import EXTRAS, not_installed

for _module in EXTRAS["atari"].modules:
    if find_spec(_module) is None:
        raise ImportError(f"The Atari games need {_module}: {not_installed(_module)}.")
