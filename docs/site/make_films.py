"""Make the films of the site again: `python docs/site/make_films.py RUNS...` from the root of the repository.

`RUNS` are folders of runs; a film whose run is in none of them is left as it is. The runs of the films come from

    sprl-bench run --suite grid-7x7 --task FourRooms-7x7 --agents ppo --seeds 1 --device cpu --out runs
    sprl-bench run --suite grid-7x7 --task KeyDoors-7x7 --agents gt-grid@tuned --seeds 1 --device cpu --out runs
    sprl-bench run --suite fetch-sparse --task FetchReach-substep2 --agents ppo --seeds 1 --device cpu --out runs
    sprl-bench run --suite maze --task MazeGoalSmall --agents gt-grid --seeds 120, --budget 1200000 --out runs
    sprl-bench run --suite atari --task MsPacman --agents ppo --seeds 120, --budget 300000 --device cuda --out runs
"""

from __future__ import annotations

import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, Final

import gymnasium
import numpy as np
from films import FILMS, Film
from PIL import Image

import sprl_bench
from sprl_bench.policies import Actor, find_actor

FRAME_MS: Final = 120
LAST_MS: Final = 900  # of the last frame of an episode
Frame = tuple[Image.Image, int]


def towards_goal(state: Any) -> Any:
    """Move the gripper straight towards the goal."""
    gripper, goal = state[10:13], state[13:16]
    return np.append(np.clip(5 * (goal - gripper), -1, 1), 0)


def always_up(_: Any) -> int:
    """Walk up, in Freeway."""
    return 2


SCRIPTS: Final = {"towards_goal": towards_goal, "always_up": always_up}


def main(runs: Sequence[Path]) -> None:
    """Film every row whose run there is."""
    gymnasium.register_envs(sprl_bench)
    for film in FILMS:
        actor = _actor(film, runs)
        if actor is None:
            print(f"{film.path}: left as it is; {film.policy} is in none of the folders.")
            continue
        save(list(frames(film, actor)), Path(film.path), film.colours)
        print(f"{film.path}: {Path(film.path).stat().st_size / 1000:.0f} kB")


def _actor(film: Film, runs: Sequence[Path]) -> Actor | None:
    if film.policy in SCRIPTS:
        return find_actor(SCRIPTS[film.policy])
    if "/" not in film.policy:
        return find_actor(film.policy)
    return next((find_actor(root / film.policy) for root in runs if (root / film.policy).exists()), None)


def frames(film: Film, actor: Actor) -> Iterator[Frame]:
    """Yield each kept frame with its time in milliseconds."""
    env = gymnasium.make(film.env_id, render_mode="rgb_array", **{**actor.arguments, **film.arguments})
    act, left, seed = actor.begin(env, film.seed), film.steps, film.seed
    for _ in range(film.episodes):
        observation, _ = env.reset(seed=seed)
        seed, ended, step = None, False, 0
        yield _picture(env, film), FRAME_MS
        while not ended and left:
            observation, _, terminated, truncated, _ = env.step(act(observation))
            ended, step, left = terminated or truncated, step + 1, left - 1
            if ended or step % film.stride == 0 or not left:
                yield _picture(env, film), LAST_MS if ended or not left else FRAME_MS
    env.close()


def _picture(env: Any, film: Film) -> Image.Image:
    image = Image.fromarray(env.render()).crop(film.crop) if film.crop else Image.fromarray(env.render())
    height = round(image.height * film.width / image.width)
    return image.resize((film.width, height), Image.Resampling.LANCZOS)


def save(shown: Sequence[Frame], path: Path, colours: int) -> None:
    """Write a GIF with one palette for all frames, so that what does not move is stored once."""
    pictures, times = zip(*shown, strict=True)
    sample = np.hstack([np.asarray(picture) for picture in pictures[:: max(1, len(pictures) // 8)]])
    palette = Image.fromarray(sample).quantize(
        colours, Image.Quantize.MAXCOVERAGE
    )  # keeps small things, such as a goal
    indexed = [picture.quantize(palette=palette, dither=Image.Dither.NONE) for picture in pictures]
    path.parent.mkdir(parents=True, exist_ok=True)
    indexed[0].save(path, save_all=True, append_images=indexed[1:], duration=list(times), loop=0, optimize=False)


if __name__ == "__main__":
    main([Path(name) for name in sys.argv[1:]])
