"""A person plays: in a window without a display, and in a pseudo terminal."""

from __future__ import annotations

import os
import pty
import re
import subprocess
import sys
import time
from collections.abc import Sequence

import pytest

from sprl_bench.cli import main
from sprl_bench.envs import GRID_IDS
from sprl_bench.play import Game, play_in_window
from sprl_bench.play.game import NAMES

pygame = pytest.importorskip("pygame")

ROOMS = "SPRL/FourRooms-7x7-v1"
KEYS = dict(zip(NAMES, ("left", "right", "up", "p", "d", "space", "enter"), strict=True))
SENT = {"left": b"\x1b[D", "right": b"\x1b[C", "up": b"\x1b[A", "p": b"p", "d": b"d", "space": b" ", "enter": b"\r"}


def _solution(env_id: str) -> list[str]:
    """Return the keys that solve the first episode, each read from what the game tells the player."""
    game, keys = Game(env_id), []
    game.press("s")
    while not game.is_over:
        keys.append(KEYS[game.status()[1].rpartition("next: ")[2]])
        game.press(keys[-1])
    return keys


@pytest.mark.parametrize("env_id", GRID_IDS)
def test_who_follows_the_path_that_the_game_shows_reaches_the_goal(env_id: str) -> None:
    game = Game(env_id)
    game.press("s")
    promised = int(game.status()[1].split()[2])
    keys = _solution(env_id)
    for key in keys:
        game.press(key)
    assert len(keys) == promised
    assert [(one.steps, one.is_success) for one in game.outcomes] == [(promised, True)]
    assert game.status()[1].startswith("Goal reached.")


def test_the_path_leads_to_the_goal_over_free_cells() -> None:
    game = Game(ROOMS)
    before = game.text()
    assert game.path_cells() == []
    game.press("s")
    *way, (x, y) = game.path_cells()
    assert before[y][2 * x] == "G"
    assert {before[y][2 * x] for x, y in way} == {" "}
    assert all(game.text()[y][2 * x] == "." for x, y in way)


def test_after_its_end_an_episode_takes_no_step_and_the_next_one_begins() -> None:
    game = Game(ROOMS)
    for key in (*_solution(ROOMS), "up", "r", "left", "x"):
        game.press(key)
    assert [one.steps for one in game.outcomes] == [len(_solution(ROOMS)), 1]


def _post(keys: Sequence[str]) -> None:
    for key in keys:
        pygame.event.post(pygame.event.Event(pygame.KEYDOWN, key=pygame.key.key_code(key)))


def test_a_window_takes_keys_and_its_cross(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    game, keys = Game(ROOMS), [{"enter": "return"}.get(key, key) for key in _solution(ROOMS)]
    pygame.init()
    _post(["s", *keys])
    pygame.event.post(pygame.event.Event(pygame.QUIT))
    play_in_window(game)
    assert game.outcomes[0].is_success
    assert game.quit


def test_a_terminal_takes_keys_and_is_left_as_it_was() -> None:
    leader, follower = pty.openpty()
    command = [sys.executable, "-m", "sprl_bench", "play", ROOMS, "--terminal"]
    process = subprocess.Popen(command, stdin=follower, stdout=follower, stderr=follower)
    os.close(follower)
    shown = _read_until(leader, b"q: quit")
    assert "return 0" in shown
    os.write(leader, b"s")
    assert "shortest path: " in _read_until(leader, b"next: ")
    os.write(leader, b"".join(SENT[key] for key in _solution(ROOMS)))
    assert "Goal reached" in _read_until(leader, b"next episode")
    os.write(leader, b"q")
    assert re.search(
        rf"episode 1: {len(_solution(ROOMS))} steps, return 0\.\d+, success", _read_until(leader, b", success")
    )
    assert process.wait(60) == 0
    os.close(leader)


def _read_until(descriptor: int, wanted: bytes) -> str:
    received, end = b"", time.monotonic() + 120
    while wanted not in received and time.monotonic() < end:
        received += os.read(descriptor, 4096)
    return received.decode()


def test_what_cannot_be_played_is_one_sentence(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["play", "SPRL/FetchReachSparse-v1"]) == 2
    assert "Mazes, Fetch and Atari cannot be played." in capsys.readouterr().err
    assert main(["play", ROOMS, "--terminal"]) == 2
    assert "needs a window or a terminal" in capsys.readouterr().err
