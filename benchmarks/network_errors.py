"""What the errors of the learned reachability network do to SPRL's cost on the grids.

`sprl` and `gt_sprl` here train as the reference agents of these names do, to the bit. Beside the verdicts that they are
priced by they ask the other judge about the same steps, and count where the two differ:

    sprl-bench run --suite grid-7x7 --task KeyDoors-7x7 --agent benchmarks.network_errors:sprl --out RUNS ...
    python -m benchmarks.network_errors RUNS
"""

from __future__ import annotations

import json
import statistics
import sys
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from sprl_baselines.agents import LearningAgentFactory
from sprl_baselines.bonus import Setting
from sprl_baselines.reachability import GroundTruth, LearnedReachability, Reachability, judge_pairs
from sprl_baselines.rollout import Rollout
from sprl_baselines.sprl import SPRL, SPRLConfig
from sprl_bench import solver
from sprl_bench.records import find_records

FAR = 6  # distances from here on count as one, with what cannot be reached at all
EVERY = 8  # of so many steps one has all its stretches looked at
WINDOWS = 8  # lines of the report for one run

Line = Mapping[str, float]


class Probed(SPRL):
    """SPRL, and how far another judge of the same steps agrees."""

    def __init__(self, setting: Setting, config: SPRLConfig, network: Reachability, *, priced_by_network: bool) -> None:
        truth = GroundTruth(setting.observation_space, config.k)
        judge, other = (network, truth) if priced_by_network else (truth, network)
        super().__init__(setting, config, judge)
        self._network = network
        self._other = SPRL(setting, config, other)
        self._priced_by_network = priced_by_network
        self._found: dict[str, float] = {}

    @classmethod
    def learned(cls, setting: Setting, config: SPRLConfig) -> Probed:
        """Price by the network, and ask the search."""
        return cls(setting, config, LearnedReachability(setting, config), priced_by_network=True)

    @classmethod
    def true(cls, setting: Setting, config: SPRLConfig) -> Probed:  # type: ignore[override] # it has a network too
        """Price by the search, and ask a network that learns beside it."""
        return cls(setting, config, LearnedReachability(setting, config), priced_by_network=False)

    def _costs(self, states: Tensor, runs: Tensor) -> Tensor:
        costs = super()._costs(states, runs)
        if self._network.ready:
            others = self._other._costs(states, runs)
            by_network, exactly = (costs, others) if self._priced_by_network else (others, costs)
            self._found = {
                "charged_by_network": float(by_network.mean()),
                "charged_exactly": float(exactly.mean()),
                "charged_by_both": float((by_network * exactly).mean()),
                **self._answers(states, runs),
            }
        return costs

    def _answers(self, states: Tensor, runs: Tensor) -> dict[str, float]:
        """Return, by exact distance, the number of stretches and of those that the network calls reached."""
        steps, num_envs = runs.shape
        flat = states.flatten(0, 1)
        rows, envs, lengths = (runs[::EVERY, :, None] >= self._lengths).nonzero(as_tuple=True)
        later = len(flat) - steps * num_envs + EVERY * rows * num_envs + envs
        earlier = later - self._lengths[lengths] * num_envs
        grids = flat.cpu().numpy()
        distances = torch.from_numpy(solver.distances(grids[earlier.cpu()], grids[later.cpu()], limit=FAR - 1))
        distances[distances < 0] = FAR
        reached = (judge_pairs(self._network, flat)(earlier, later) > 0.5).cpu().float()
        found = {}
        for distance in range(FAR + 1):
            here = distances == distance
            found[f"stretches_at_{distance}"] = float(here.sum())
            found[f"reached_at_{distance}"] = float(reached[here].sum())
        return found

    def update(self, rollout: Rollout) -> Mapping[str, float]:
        """Let the network learn, whoever prices, and return the counts too."""
        return {**self._other.reachability.update(rollout), **super().update(rollout), **self._found}

    def state_dict(self) -> dict[str, Any]:
        """Return the state of both judges."""
        return {**super().state_dict(), "other": self._other.reachability.state_dict(), "found": dict(self._found)}

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Take such a state."""
        super().load_state_dict(state)
        self._other.reachability.load_state_dict(state["other"])
        self._found = dict(state["found"])


sprl = LearningAgentFactory("sprl", Probed.learned, SPRLConfig, privileged=True)
gt_sprl = LearningAgentFactory("gt-sprl", Probed.true, SPRLConfig, privileged=True)


def report(run: Path) -> str:
    """Return a line for each part of a run in which something was counted: charges, and answers by distance."""
    lines = [json.loads(line) for line in (run / "metrics.jsonl").read_text().splitlines()]
    last = max((line["env_steps"] for line in lines), default=0)
    rows = []
    for window in range(WINDOWS):
        inside = [line for line in lines if window < WINDOWS * line["env_steps"] / last <= window + 1]
        if any("charged_exactly" in line for line in inside):
            rows.append(_row(last * (window + 1) // WINDOWS, inside))
    return "\n".join(rows) or "nothing was counted"


def _row(until: int, lines: list[Line]) -> str:
    accuracy = _mean(lines, "reachability_accuracy")
    exactly, by_network, both = (_mean(lines, f"charged_{how}") for how in ("exactly", "by_network", "by_both"))
    stretches = [sum(line.get(f"stretches_at_{distance}", 0) for line in lines) for distance in range(FAR + 1)]
    reached = [sum(line.get(f"reached_at_{distance}", 0) for line in lines) for distance in range(FAR + 1)]
    shares = " ".join(f"{count / max(sum(stretches), 1):.2f}" for count in stretches)
    answers = " ".join(f"{yes / count:.2f}" if count else "-" for yes, count in zip(reached, stretches, strict=True))
    return (
        f"to {until:>9,}: accuracy {accuracy:.3f}; charged exactly {exactly:.3f}, by the network {by_network:.3f}, "
        f"by both {both:.3f}; reached at 0 to {FAR}: {answers} (shares {shares})"
    )


def _mean(lines: Iterable[Line], name: str) -> float:
    values = [line[name] for line in lines if line.get(name) is not None]
    return statistics.mean(values) if values else float("nan")


def main(runs: Path) -> None:
    """Print the report of every finished run below a folder."""
    for record in find_records(runs):
        print(f"{record.spec.task.name}, {record.spec.agent}, seed {record.spec.seed}")
        print(report(record.spec.path(runs)))


if __name__ == "__main__":
    if len(sys.argv) != 2:
        sys.exit("Name one folder of runs: python -m benchmarks.network_errors RUNS")
    main(Path(sys.argv[1]))
