"""Videos: episodes of an environment under a policy, written whole or not at all.

Time runs as in the environment, by its metadata's `render_fps`. Frames beyond the rate of a player are left out, but
never the first or the last of an episode. Frames go straight into the file: a long video takes no more memory than a
short one. imageio is loaded when something is filmed.
"""

from __future__ import annotations

import contextlib
import errno
import math
import os
import secrets
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any, Final

import gymnasium
from numpy.typing import NDArray

from sprl_bench.agents import Policy
from sprl_bench.envs import IDS
from sprl_bench.envs.checks import check_integer
from sprl_bench.extras import require_extra
from sprl_bench.policies import find_actor
from sprl_bench.suggestions import unknown
from sprl_bench.tasks import Argument

Env = gymnasium.Env[Any, Any]


class CannotDrawError(ValueError):
    """This machine cannot draw the environment."""


@dataclass(frozen=True)
class Episode:
    """A filmed episode."""

    steps: int  # environment steps
    total_reward: float
    is_success: bool  # whether the goal was reached


@dataclass(frozen=True)
class Format:
    """A kind of file."""

    needs: tuple[str, ...]  # the modules that write it
    most_frames: int  # a second, for players
    options: Callable[[float], dict[str, Any]]  # of imageio, given the frames a second


_FORMATS: Mapping[str, Format] = MappingProxyType(
    {
        # Delays are hundredths of a second; players show one below 0.02 s as 0.1 s.
        ".gif": Format(("imageio",), 50, lambda fps: {"duration": 10 * round(100 / fps), "loop": 0}),
        # H.264 needs an even width and height.
        ".mp4": Format(
            ("imageio", "imageio_ffmpeg"), 60, lambda fps: {"format": "FFMPEG", "fps": fps, "macro_block_size": 2}
        ),
    }
)
SUFFIXES: Final = tuple(_FORMATS)


def record_video(
    env_id: str,
    output: Path | str,
    *,
    policy: str | Policy = "random",
    agent: str | None = None,
    arguments: Mapping[str, Argument] = MappingProxyType({}),
    episodes: int = 1,
    seed: int = 0,
) -> list[Episode]:
    """Film episodes of an environment, and return their lengths and returns.

    Args:
        env_id: The Gymnasium id.
        output: A .mp4 or .gif file; it is overwritten.
        policy: `random`, `still`, `solver` (on grids and mazes), "package.module:function", a run's folder, or a
            function from an observation to an action.
        agent: The "package.module:factory" of a run's agent, unless it is an installed one.
        arguments: Of the environment; by default those of the run.
        episodes: How many, one after the other.
        seed: Of the environment and of the random policy.

    Raises:
        ValueError: The id, an argument, the policy, a number or the file's suffix is not allowed.
        UnplayableRunError: The policy is a run whose agent cannot act, or has to be named.
        CannotDrawError: This machine cannot draw the environment.
        OSError: The file cannot be written.
        ModuleNotFoundError: The extra `video`, or one that the environment needs, is not installed.
    """
    path = Path(output)
    made = _format(path)
    check_integer("episodes", episodes, 1)
    check_integer("seed", seed, 0)
    actor = find_actor(policy, agent)
    with contextlib.closing(_make(env_id, {**actor.arguments, **arguments})) as env:
        play = actor.begin(env, seed)
        steps_a_second = env.metadata.get("render_fps", made.most_frames)
        stride = math.ceil(steps_a_second / made.most_frames)
        with _open(path, made.options(steps_a_second / stride)) as film:
            # The first episode is seeded; the others follow from it.
            return [_shoot(env, play, chosen, film, stride) for chosen in (seed, *[None] * (episodes - 1))]


def _format(path: Path) -> Format:
    """Return the format of the file's suffix, and check that the modules for it are installed."""
    if path.suffix.lower() not in _FORMATS:
        raise ValueError(unknown("suffix of a video:", path.suffix, SUFFIXES))
    if path.is_dir():
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), str(path))
    found = _FORMATS[path.suffix.lower()]
    for module in found.needs:
        require_extra(module)
    return found


def _make(env_id: str, arguments: Mapping[str, Argument]) -> Env:
    if "render_mode" in arguments:
        raise ValueError(
            f"render_mode is {arguments['render_mode']!r}; it must be left out: a video always uses 'rgb_array'."
        )
    if ":" not in env_id and env_id not in gymnasium.registry:
        raise ValueError(unknown("environment", env_id, IDS))
    try:
        return gymnasium.make(env_id, render_mode="rgb_array", **arguments)  # type: ignore[arg-type] # passed on
    except (TypeError, gymnasium.error.Error) as error:
        raise ValueError(str(error.__cause__ or error)) from error  # Gymnasium appends its own words


@contextlib.contextmanager
def _open(path: Path, options: Mapping[str, Any]) -> Iterator[Any]:
    """Open a temporary film beside `path`, renamed when it is whole and removed on an error."""
    import imageio.v2  # noqa: PLC0415 - the extra `video`

    path.parent.mkdir(parents=True, exist_ok=True)
    temporary = path.with_name(f".{path.stem}.{secrets.token_hex(4)}{path.suffix.lower()}")
    try:
        temporary.touch(exist_ok=False)
        writer: Any = imageio.v2.get_writer(temporary, **options)
        with writer as film:
            yield film
        temporary.replace(path)
    except BaseException as error:
        temporary.unlink(missing_ok=True)
        if isinstance(error, OSError) and error.filename == str(temporary):
            raise OSError(error.errno, error.strerror, str(path)) from error
        raise


def _shoot(env: Env, policy: Policy, seed: int | None, film: Any, stride: int) -> Episode:
    """Play one episode, and film its first state, every `stride`-th one, and the last."""
    observation, info = env.reset(seed=seed)
    film.append_data(_draw(env))
    steps, total_reward, is_over = 0, 0.0, False
    while not is_over:
        observation, reward, terminated, truncated, info = env.step(policy(observation))
        steps, total_reward, is_over = steps + 1, total_reward + float(reward), terminated or truncated
        if is_over or steps % stride == 0:
            film.append_data(_draw(env))
    return Episode(steps, total_reward, bool(info.get("is_success", False)))


def _draw(env: Env) -> NDArray[Any]:
    try:
        picture: Any = env.render()
    except Exception as error:  # a graphics driver may raise anything
        raise CannotDrawError(
            f"Pictures cannot be drawn here ({type(error).__name__}: {error}); sprl-bench doctor says more."
        ) from error
    return picture  # type: ignore[no-any-return] # render() has no types
