"""The only writer of scores: episodes as the environment gave them, and the record they come to."""

from __future__ import annotations

from sprl_bench.recorder.episodes import EpisodeLog
from sprl_bench.recorder.scripts import record, recording
from sprl_bench.recorder.wrappers import EnvRecorder, VectorRecorder

__all__ = ["EnvRecorder", "EpisodeLog", "VectorRecorder", "record", "recording"]
