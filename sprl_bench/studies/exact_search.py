"""Figure 17's yardstick: what exact search scores on the pairs by which a network's accuracy is measured.

Pairs are drawn from stretches of steps without a reward or an ending. A pair is negative because many steps lie between
its states, not because many are needed, so exact search does not score 100 % either (appendix B.1 and B.2).
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import gymnasium
import numpy as np

from sprl_bench import solver
from sprl_bench.policies import UnplayableRunError, restore
from sprl_bench.records import RunRecord, RunSpec, read
from sprl_bench.records.folder import RECORD
from sprl_bench.scores import Array

Act = Callable[[Any], Any]

STEPS: Final = 12_000  # env steps that a policy is watched for
PAIRS: Final = 4_000  # positives, and as many negatives
SEED: Final = 17


def comparison(measured: Sequence[tuple[RunSpec, float]], folders: Sequence[Path]) -> str:
    """Return a row a grid, Markdown; empty without a measurement.

    Args:
        measured: The accuracy of the network of each run.
        folders: The folders of the finished runs.
    """
    if not measured:
        return ""
    trained = [(read(folder / RECORD, RunRecord).spec.task.env_id, by_trained(folder)) for folder in folders]
    head = ["grid", "network", "exact search, random policy", "exact search, last policies"]
    rows = [head, ["---"] * len(head)]
    for env_id, spec in {spec.task.env_id: spec for spec, _ in measured}.items():
        networks = [value for one, value in measured if one.task.env_id == env_id]
        searches = [value for one, value in trained if one == env_id]
        chance = by_random(env_id, *horizon(spec.hyperparameters))
        name = env_id.removeprefix("SPRL/").removesuffix("-v1")
        rows.append([name, _spread(networks), _spread([chance]), _spread(searches)])
    return "\n".join(f"| {' | '.join(row)} |" for row in rows)


def _spread(values: Sequence[float]) -> str:
    """Return the mean over seeds, and the least and the largest where there are several."""
    known = [value for value in values if not np.isnan(value)]
    if len(set(known)) < 2:
        return f"{known[0]:.3f}" if known else "-"
    return f"{np.mean(known):.3f} ({min(known):.3f} to {max(known):.3f})"


@functools.cache
def by_random(env_id: str, k: int, tolerance: int, negative_bias: int) -> float:
    """Return the accuracy of exact search on the steps of a uniformly random policy."""
    env = gymnasium.make(f"sprl_bench:{env_id}")
    env.action_space.seed(SEED)
    return accuracy(_stretches(env, lambda _: env.action_space.sample()), k, tolerance, negative_bias)


@functools.cache
def by_trained(folder: Path) -> float:
    """Return the accuracy of exact search on the steps of a run's last policy; nan if it cannot act.

    Raises:
        FileNotFoundError: The folder holds no run.
    """
    spec = read(folder / RECORD, RunRecord).spec
    env = gymnasium.make(f"sprl_bench:{spec.task.env_id}")
    try:
        policy = restore(folder, spec).policy(env.observation_space, env.action_space, SEED)
    except (UnplayableRunError, ValueError):
        return float("nan")
    return accuracy(_stretches(env, policy), *horizon(spec.hyperparameters))


def horizon(hyperparameters: Mapping[str, Any]) -> tuple[int, int, int]:
    """Return k, the tolerance and the negative bias."""
    return tuple(hyperparameters[name] for name in ("k", "tolerance", "negative_bias"))


def accuracy(stretches: Sequence[Array], k: int, tolerance: int, negative_bias: int) -> float:
    """Return the share of pairs that exact search answers as the measure does; nan if the stretches are too short.

    Args:
        stretches: Observations of successive steps, each [L, H, W, 3].
        k: Steps within which exact search calls a state reached.
        tolerance: Positives lie 1 to k + tolerance steps apart.
        negative_bias: Negatives lie k + tolerance + this to k + tolerance + twice this apart.
    """
    reach = k + tolerance
    least, most = reach + negative_bias, reach + 2 * negative_bias
    anchors = [(stretch, start) for stretch in stretches for start in range(len(stretch) - least)]
    if not anchors:
        return float("nan")
    generator = np.random.default_rng(SEED)
    chosen = [anchors[rank] for rank in generator.integers(len(anchors), size=PAIRS)]
    near = np.stack([one[at + generator.integers(1, reach + 1)] for one, at in chosen])
    far = np.stack([one[at + generator.integers(least, min(most, len(one) - 1 - at) + 1)] for one, at in chosen])
    sources = np.stack([one[at] for one, at in chosen])
    return float((solver.reachable(sources, near, k).mean() + 1 - solver.reachable(sources, far, k).mean()) / 2)


def _stretches(env: gymnasium.Env[Any, Any], act: Act) -> list[Array]:
    """Return the observations of each stretch without a reward or an ending, over `STEPS` steps, and close the env."""
    observation, _ = env.reset(seed=SEED)
    stretches = [[observation]]
    for _ in range(STEPS):
        observation, reward, terminated, truncated, _ = env.step(act(observation))
        if terminated or truncated:
            observation, _ = env.reset()
        if reward or terminated or truncated:
            stretches.append([])
        stretches[-1].append(observation)
    env.close()
    return [np.stack(stretch) for stretch in stretches]
