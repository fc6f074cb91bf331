"""Draw where walks of low and of high cost go, as Figure 22 does: `python notes/draw_costs.py docs/costs.png`.

All walks begin in one state of FourRooms-11x11 and take 60 uniformly random actions. SPRL's cost has Table 1's settings
and exact search. Walks that find the goal are left out, because they are shorter.
"""

from __future__ import annotations

import sys
from typing import Any

import gymnasium
import matplotlib as mpl
import numpy as np
import torch

import sprl_bench  # noqa: F401 - registers the ids
from sprl_baselines.bonus import Setting
from sprl_baselines.learning.collector import Collector, Decision
from sprl_baselines.sprl import SPRL, ConstraintConfig

mpl.use("Agg")
from matplotlib import pyplot

ENV_ID, SEED = "SPRL/FourRooms-11x11-v1", 0
WALKS, STEPS = 4000, 60
WALL = 2  # Minigrid's code


def main(path: str) -> None:
    """Draw the map, and the visits of the cheapest and of the dearest quarter of the walks."""
    picture, walls = start()
    positions, costs = walks()
    cheap, dear = np.quantile(costs, [0.25, 0.75])
    panels: Any
    figure, panels = pyplot.subplots(1, 3, figsize=(11, 3.6), layout="constrained")
    panels[0].imshow(picture, interpolation="nearest")
    panels[0].set_title("Where all walks begin", fontsize=11)
    shares = [visits(positions[:, chosen], walls.shape) for chosen in (costs <= cheap, costs >= dear)]
    means = [costs[chosen].mean() for chosen in (costs <= cheap, costs >= dear)]
    scale = mpl.colors.LogNorm(1e-4, max(share.max() for share in shares), clip=True)
    for panel, share, mean, name in zip(panels[1:], shares, means, ("Lowest", "Highest"), strict=True):
        image = panel.imshow(np.ma.masked_array(share, walls), norm=scale, cmap="viridis")
        panel.set_facecolor("0.75")
        panel.set_title(f"{name} quarter: {mean:.0f} of {STEPS} steps charged", fontsize=11)
    for panel in panels:
        panel.set_xticks([])
        panel.set_yticks([])
    figure.colorbar(image, ax=panels[1:], label="share of time in a cell")
    figure.savefig(path, dpi=110)


def start() -> tuple[np.ndarray, np.ndarray]:
    """Return a picture of the first state, and which cells are walls, `[H, W]`."""
    env = gymnasium.make(ENV_ID, render_mode="rgb_array")
    observation, _ = env.reset(seed=SEED)
    picture = env.render()
    env.close()
    return np.asarray(picture), observation[..., 0] == WALL


def walks() -> tuple[np.ndarray, np.ndarray]:
    """Return the positions `[STEPS + 1, W, 2]` and the summed costs `[W]` of the walks that do not find the goal."""
    envs: Any = gymnasium.make_vec(ENV_ID, num_envs=WALKS)
    collector = Collector(envs, STEPS, torch.device("cpu"))
    collector.reset()
    first, infos = envs.reset(seed=[SEED] * WALKS)
    collector.load_state_dict({**collector.state_dict(), "observations": first, "positions": infos["position"]})
    setting = Setting(envs.single_observation_space, envs.single_action_space, WALKS, 0, torch.device("cpu"))
    cost = SPRL.true(setting, ConstraintConfig(cost_scale=1.0, bias=0.0))
    generator, zeros = torch.Generator().manual_seed(SEED), torch.zeros(WALKS)
    rollout = collector.collect(lambda _: Decision(torch.randint(7, (WALKS,), generator=generator), zeros, zeros))
    kept = ~rollout.ended.any(dim=0)
    positions = torch.cat((rollout.positions, rollout.next_positions[-1:]))
    return positions[:, kept].numpy(), -cost.reward(rollout).sum(dim=0)[kept].numpy()


def visits(positions: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
    """Return the share of time that walks spend in each cell, `[H, W]`."""
    counts = np.zeros(shape)
    np.add.at(counts, (positions[..., 1], positions[..., 0]), 1)
    return counts / counts.sum()


if __name__ == "__main__":
    main(sys.argv[1])
