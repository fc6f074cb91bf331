"""One Atari game: the batch of one emulator, as a Gymnasium environment."""

from __future__ import annotations

from typing import Any, ClassVar, Final

import gymnasium
import numpy as np
from gymnasium.error import ResetNeeded
from numpy.typing import NDArray

from sprl_bench.envs.atari.emulators import Emulators
from sprl_bench.envs.atari.preprocessing import HORIZON, METADATA, NUM_ACTIONS, action_space, observation_space
from sprl_bench.envs.atari.screen import Screen
from sprl_bench.envs.checks import check_choice, check_integer, refuse_unknown

_ONLY: Final = np.zeros(1, np.int64)
_RUNS: Final = np.ones(1, np.bool_)
ARGUMENTS: Final = ("render_mode",)

Observation = NDArray[np.uint8]


class AtariEnv(gymnasium.Env[Any, Any]):
    """
    ## Description

    An Atari 2600 game in ale-py's emulator, preprocessed as in Table 3 of the paper's appendix F. It is ale-py's own
    vector environment with one game. There are no sticky actions.

    - MontezumaRevenge: rooms with keys, doors and enemies; the first points need some hundred right actions.
    - Freeway: cross a road of ten lanes; a point for each crossing.
    - MsPacman: eat all dots of a maze with four ghosts.
    - Gravitar: land on planets against their gravity and destroy bunkers.
    - Seaquest: a submarine collects divers and shoots fish, with limited air.
    - Hero: a miner flies and blasts through a shaft to a trapped worker.

    ## Action Space

    `Discrete(18)`: all directions with and without the button, in ale-py's order. An action lasts four frames.

    ## Observation Space

    `Box(0, 255, (4, 84, 84), uint8)`: the last four processed frames, oldest first. A processed frame is the maximum of
    an action's last two frames, in grey, resized to 84 x 84. At the start of an episode the three older ones are black.

    `info` holds `is_success` (bool): whether the episode has had a reward above 0.

    ## Rewards

    The game's points during the four frames. They are not clipped.

    ## Starting State

    The game's start after 0 to 30 frames without an action (the OpenAI Baselines have 1 to 30). The emulator's
    random memory at power-on differs between episodes.

    ## Episode End

    1. Terminated: the game is over. A lost life does not end an episode.
    2. Truncated: 10,000 actions were taken and the last did not terminate.

    ## Arguments

    - `render_mode`: None, `"rgb_array"` (the screen in colour, 210 x 160) or `"human"`.

    ## Version history

    - v1: first version.
    """  # noqa: D212, D415 - the sections have Gymnasium's form

    metadata = METADATA
    game: ClassVar[str]

    def __init__(self, *, render_mode: str | None = None, **unknown: Any) -> None:
        refuse_unknown(type(self).__name__, unknown, ARGUMENTS)
        check_choice("render_mode", render_mode, [None, *self.metadata["render_modes"]])
        self.render_mode = render_mode
        self.observation_space = observation_space()
        self.action_space = action_space()
        self.emulators = Emulators(self.game, 1)
        self._is_success = self._is_running = self._is_reset = False
        self._screen: Screen | None = None

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Start an episode. A `seed` determines this and all following episodes."""
        super().reset(seed=seed, options=options)
        if seed is not None:
            self.emulators.renew(_ONLY)
        self.emulators.restart(_ONLY, [self.np_random])
        self._is_success, self._is_running, self._is_reset = False, True, True
        self._draw_window()
        return self._observation(), {"is_success": False}

    def step(self, action: int) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """Take one action for four frames.

        Raises:
            ResetNeeded: No episode is running.
            TypeError: `action` is not an integer. No state has changed.
            ValueError: `action` is not in 0 .. 17. No state has changed.
        """
        if not self._is_running:
            raise ResetNeeded("step() needs a reset() before it: no episode is running.")
        action = check_integer("action", action, 0, NUM_ACTIONS - 1)
        outcome = self.emulators.step(np.array([action]), _RUNS)
        reward, terminated = outcome.rewards.item(), outcome.terminated.item()
        truncated = bool(self.emulators.arrays["taken"][0] >= HORIZON) and not terminated
        self._is_success |= reward > 0
        self._is_running = not (terminated or truncated)
        self._draw_window()
        return self._observation(), reward, terminated, truncated, {"is_success": self._is_success}

    def _observation(self) -> Observation:
        return np.array(self.emulators.newest[0])

    def load(self, arrays: dict[str, NDArray[Any]], *, is_success: bool, is_running: bool) -> None:
        """Set the state of an episode, except for the random generator.

        Args:
            arrays: Of one emulator, as in `Emulators.arrays`.
            is_success: Whether the episode has had a reward above 0.
            is_running: Whether it has not ended.
        """
        self.emulators.arrays = arrays
        self.emulators.replay()
        self._is_success, self._is_running, self._is_reset = is_success, is_running, True

    def screen(self) -> Screen:
        """Return the screen of the present.

        Raises:
            ResetNeeded: There was no reset yet.
        """
        if not self._is_reset:
            raise ResetNeeded("render() needs a reset() before it.")
        if self._screen is None:
            self._screen = Screen(self.game)
        seed, episodes, taken = (int(self.emulators.arrays[name][0]) for name in ("seeds", "episodes", "taken"))
        key = seed, episodes, int(self.emulators.no_ops[0])
        self._screen.reach(key, self.emulators.arrays["actions"][0, :taken])
        return self._screen

    def render(self) -> Any:
        """Return the screen, uint8 [210, 160, 3], or show it with `"human"`; the game does not change."""
        if self.render_mode is None:
            gymnasium.logger.warn(f'{self} has no render mode; make it with render_mode="rgb_array" or "human".')
            return None
        screen = self.screen()
        return screen.picture() if self.render_mode == "rgb_array" else screen.show()

    def _draw_window(self) -> None:
        if self.render_mode == "human":
            self.render()

    def close(self) -> None:
        """Close the window, if there is one."""
        if self._screen is not None:
            self._screen.close()
            self._screen = None

    def __getstate__(self) -> dict[str, Any]:
        """Exclude the screen: a copy has its own when it is first drawn."""
        return {**self.__dict__, "_screen": None}


class MontezumaRevenge(AtariEnv):
    """Montezuma's Revenge."""

    game = "montezuma_revenge"


class Freeway(AtariEnv):
    """Freeway."""

    game = "freeway"


class MsPacman(AtariEnv):
    """Ms. Pac-Man."""

    game = "ms_pacman"


class Gravitar(AtariEnv):
    """Gravitar."""

    game = "gravitar"


class Seaquest(AtariEnv):
    """Seaquest."""

    game = "seaquest"


class Hero(AtariEnv):
    """H.E.R.O."""

    game = "hero"
