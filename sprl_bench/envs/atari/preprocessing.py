"""The preprocessing of Table 3, and what ale-py's vector environment is made with."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any, Final

import numpy as np
from gymnasium.spaces import Box, Discrete

HORIZON: Final = 10_000
"""Agent steps of the longest episode (Table 3: Max Episode Length)."""
FRAMES_PER_STEP: Final = 4
"""Emulator frames of an action (Table 3: Action Repetitions)."""
FRAMES_SEEN: Final = 4
"""Processed frames in an observation (Table 3: Frame Stacking)."""
SIDE: Final = 84
"""Pixels along each side of a processed frame (Table 3)."""
NUM_ACTIONS: Final = 18
"""All directions with and without the button (Table 3)."""
MOST_NO_OPS: Final = 30
"""Frames without an action at the start of an episode are uniform from 0 to this many."""

SETTINGS: Final[Mapping[str, Any]] = MappingProxyType(
    {
        "frame_skip": FRAMES_PER_STEP,
        "stack_num": FRAMES_SEEN,
        "img_height": SIDE,
        "img_width": SIDE,
        "grayscale": True,
        "maxpool": True,  # the maximum of the last two of the four frames
        "noop_max": MOST_NO_OPS + 1,  # ale-py draws from 0 to one less
        "use_fire_reset": False,
        "episodic_life": False,  # no end at a lost life (Table 3)
        "life_loss_info": False,
        "reward_clipping": False,  # rewards are the game's points; an agent may clip them
        "repeat_action_probability": 0.0,
        "full_action_space": True,
        "max_episode_steps": 2**31 - 1,  # the environments end an episode at HORIZON themselves
        "batch_size": 0,  # a step is a step of all
        "thread_affinity_offset": -1,
    }
)
"""The arguments of `ale_py.ALEVectorInterface` that do not depend on the run."""

METADATA: Final[dict[str, Any]] = {"render_modes": ["human", "rgb_array"], "render_fps": 60 // FRAMES_PER_STEP}


def observation_space() -> Box:
    """Return the space of the last four processed frames, oldest first, uint8 [4, 84, 84]."""
    return Box(0, 255, (FRAMES_SEEN, SIDE, SIDE), np.uint8)


def action_space() -> Discrete:
    """Return the space of the 18 actions, in ale-py's order."""
    return Discrete(NUM_ACTIONS)
