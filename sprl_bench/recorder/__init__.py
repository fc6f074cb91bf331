"""The only writer of scores: from the environment's own episodes to a run's record."""

from __future__ import annotations

from sprl_bench.recorder.episodes import EpisodeLog
from sprl_bench.recorder.scripts import record, recording
from sprl_bench.recorder.wrappers import EnvRecorder, VectorRecorder

__all__ = ["EnvRecorder", "EpisodeLog", "VectorRecorder", "record", "recording"]
