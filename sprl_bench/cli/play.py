"""The command with which a person plays."""

from __future__ import annotations

from typing import Annotated

import typer


def play(
    env_id: Annotated[str, typer.Argument(metavar="ID", help="A grid task, such as SPRL/FourRooms-7x7-v1.")],
    seed: Annotated[int, typer.Option(min=0, help="Of the first episode.")] = 0,
    terminal: Annotated[
        bool, typer.Option("--terminal", help="Play in the terminal, even where a window opens.")
    ] = False,
) -> None:
    """Play a grid task by keyboard, in a window or, where there is none, in the terminal."""
    from sprl_bench.play import Game, can_open_window, play_in_terminal, play_in_window

    game = Game(env_id, seed)
    try:
        (play_in_terminal if terminal or not can_open_window() else play_in_window)(game)
    finally:
        game.close()
    for number, one in enumerate(game.outcomes, start=1):
        end = "success" if one.is_success else "no success"
        typer.echo(f"episode {number}: {one.steps} steps, return {one.total_reward:g}, {end}")
