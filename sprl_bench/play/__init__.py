"""A person plays a grid task by keyboard, in a window or in a terminal."""

from __future__ import annotations

from sprl_bench.play.game import Game, Outcome
from sprl_bench.play.terminal import play_in_terminal
from sprl_bench.play.window import can_open_window, play_in_window

__all__ = ["Game", "Outcome", "can_open_window", "play_in_terminal", "play_in_window"]
