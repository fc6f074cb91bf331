"""Reachability learned from the agent's own experience: training data, schedule and readiness."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator, Mapping
from typing import Any, ClassVar

import torch
from torch import Tensor, nn
from torch.nn.functional import binary_cross_entropy_with_logits

from sprl_baselines.bonus import Setting
from sprl_baselines.learning.rollout import Rollout, Rows
from sprl_baselines.learning.training_state import load_weights, restore, saved
from sprl_baselines.reachability.hyperparameters import ReachabilityConfig
from sprl_baselines.reachability.network import reachability_network
from sprl_baselines.reachability.pairs import Judge, judge_pairs
from sprl_baselines.reachability.replay import Replay
from sprl_baselines.reachability.residual import SMALL
from sprl_baselines.reachability.triplets import Triplets, accuracy_ranges, scatter, training_ranges, walk


class LearnedReachability:
    """A network trained on triplets from a replay (appendix E.3).

    Its accuracy is measured as in appendix B.1, on the steps since the last training, before it is trained on them.

    Args:
        setting: The environment, seed and device.
        config: Hyperparameters.
        blocks: Residual blocks of the network for images.

    Raises:
        ValueError: There is no network for the observations, or the replay is too small for a negative.
    """

    privileged: ClassVar[bool] = False

    def __init__(self, setting: Setting, config: ReachabilityConfig, blocks: tuple[int, ...] = SMALL) -> None:
        self._replay = Replay(config.replay_size, setting.num_envs)
        self._ranges = training_ranges(config.k, config.tolerance, config.negative_bias, config.negatives)
        nearest, _ = self._ranges.negative
        if self._replay.capacity <= nearest:
            raise ValueError(
                f"Hyperparameter replay_size is {config.replay_size}; it must be more than "
                f"{nearest * setting.num_envs}, num_envs times the {nearest} steps to the nearest negative."
            )
        self.config = config
        self._device = setting.device
        self._generator = torch.Generator().manual_seed(setting.seed)
        self.network = reachability_network(
            setting.observation_space,
            self._generator,
            view=setting.view,
            embedding_units=config.embedding_units,
            layers=config.head_layers,
            units=config.head_units,
            pair_input=config.pair_input,
            blocks=blocks,
        ).to(setting.device)
        self.network.eval()
        self._optimizer = torch.optim.Adam(
            _decaying_weights(self.network, config.weight_decay), lr=config.reachability_learning_rate, fused=True
        )
        self._accuracies: deque[float] = deque(maxlen=config.ready_trainings)
        self._ready = False
        self._steps = 0  # env steps seen
        self._trained_at = 0  # env steps seen when training was last due
        self._fresh_rows = 0  # rows added to the replay since then

    @property
    def ready(self) -> bool:
        """Whether the mean accuracy of the last `ready_trainings` trainings has once exceeded `ready_accuracy`."""
        return self._ready

    def judge_of(self, states: Tensor) -> Judge:
        """Embed D states `[D, ...]` once, and return a judge of pairs of them."""
        with torch.inference_mode():
            compare = self.network(states)

        def judge(earlier: Tensor, later: Tensor) -> Tensor:
            with torch.inference_mode():
                logits: Tensor = compare(earlier, later)
                return logits.sigmoid()

        return judge

    def update(self, rollout: Rollout) -> dict[str, float]:
        """Add the rollout to the replay, and train if a training is due."""
        self._replay.append(rollout.observations, rollout.cuts)
        self._steps += rollout.num_steps
        self._fresh_rows += len(rollout.rewards)
        half_full = 2 * self._replay.rows > self._replay.capacity
        if not half_full or self._steps - self._trained_at < self._interval():
            return {}
        accuracy = self._held_out_accuracy()
        triplets = self._draw()
        self._trained_at, self._fresh_rows = self._steps, 0
        return {**accuracy, **self._train(triplets), "reachability_ready": float(self._ready)}

    def _interval(self) -> int:
        """Return the current number of env steps between two trainings."""
        config = self.config
        if config.last_from and self._steps > config.last_from:
            return config.train_every_last
        if config.later_from and self._steps > config.later_from:
            return config.train_every_later
        return config.train_every

    def _draw(self) -> Triplets:
        """Draw triplets from the whole replay, in random order, at most `max_pairs` pairs."""
        config, segments = self.config, self._replay.segments()
        triplets = walk(segments, self._ranges, config.positive_bias, self._generator)
        order = torch.randperm(len(triplets.anchors), generator=self._generator)
        return triplets.take(order[: config.max_pairs // 2])

    def _train(self, triplets: Triplets) -> dict[str, float]:
        """Train on all triplets once; do nothing if there are too few for a batch."""
        batches = list(self._batches(triplets))
        count = float(len(triplets.anchors))
        if not batches:
            return {"reachability_triplets": count}
        self.network.train()
        steps = torch.stack([self._gradient_step(batch) for batch in batches])
        self.network.eval()
        loss, accuracy = steps.mean(dim=0).tolist()
        self._accuracies.append(accuracy)
        enough = len(self._accuracies) == self.config.ready_trainings
        self._ready |= enough and sum(self._accuracies) / len(self._accuracies) > self.config.ready_accuracy
        return {
            "reachability_triplets": count,
            "reachability_loss": loss,
            "reachability_training_accuracy": accuracy,
        }

    def _batches(self, triplets: Triplets) -> Iterator[Triplets]:
        """Yield full batches. The rest is left out, because batch normalisation needs enough pairs."""
        size = self.config.pair_batch // 2
        for start in range(0, len(triplets.anchors) - size + 1, size):
            yield triplets.take(torch.arange(start, start + size))

    def _gradient_step(self, batch: Triplets) -> Tensor:
        """Take a gradient step on a batch; return its loss and accuracy, `[2]`."""
        logits, labels = self._logits(batch)
        smoothing = self.config.label_smoothing
        loss = binary_cross_entropy_with_logits(logits, labels * (1 - smoothing) + smoothing / 2)
        self._optimizer.zero_grad()
        loss.backward()  # type: ignore[no-untyped-call] # torch has no types there
        self._optimizer.step()
        return torch.stack((loss.detach(), _share_right(logits, labels)))

    def _logits(self, triplets: Triplets) -> tuple[Tensor, Tensor]:
        """Return logits and labels, `[2 P]` each, of the pairs (anchor, positive) and (anchor, negative)."""
        states, (anchors, positives, negatives) = self._states(triplets)
        compare = self.network(states)
        logits = compare(torch.cat((anchors, anchors)), torch.cat((positives, negatives)))
        return logits, (torch.arange(len(logits), device=logits.device) < len(anchors)).float()

    def _states(self, triplets: Triplets) -> tuple[Tensor, Triplets]:
        """Return the D states at the triplets' places, `[D, ...]`, and the triplets as indices of these."""
        places, indices = torch.cat(triplets).unique(return_inverse=True)  # type: ignore[no-untyped-call] # torch has no types there
        return self._replay.take(places), Triplets(*indices.to(self._device).chunk(3))

    def _held_out_accuracy(self) -> dict[str, float]:
        """Return the accuracy on steps not yet trained on, or no metric if they have no pairs to judge."""
        ranges = accuracy_ranges(self.config.k, self.config.tolerance, self.config.negative_bias)
        triplets = scatter(
            self._replay.segments(newest=self._fresh_rows), ranges, self.config.accuracy_pairs, self._generator
        )
        if not len(triplets.anchors):
            return {}
        states, (anchors, positives, negatives) = self._states(triplets)
        judge = judge_pairs(self, Rows.of(states))
        right = torch.cat((judge(anchors, positives) > 0.5, judge(anchors, negatives) <= 0.5))
        return {"reachability_accuracy": float(right.float().mean())}

    def weights(self) -> Mapping[str, Any]:
        """Return the network's parameters, as the part of a state that judging needs."""
        return {"network": saved(self.network, self._optimizer, self._generator)["network"]}

    def load_weights(self, weights: Mapping[str, Any]) -> None:
        """Take such parameters."""
        load_weights(self.network, weights["network"])

    def state_dict(self) -> dict[str, Any]:
        """Return the network, its optimizer, the replay and the readiness."""
        return {
            **saved(self.network, self._optimizer, self._generator),
            "replay": self._replay.state_dict(),
            "accuracies": torch.tensor(list(self._accuracies), dtype=torch.float64),
            "ready": self._ready,
            "steps": self._steps,
            "trained_at": self._trained_at,
            "fresh_rows": self._fresh_rows,
        }

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Restore such a state."""
        restore(self.network, self._optimizer, self._generator, state)
        self._replay.load_state_dict(state["replay"], self._device)
        self._accuracies.clear()
        self._accuracies.extend(state["accuracies"].tolist())
        self._ready = bool(state["ready"])
        self._steps, self._trained_at = int(state["steps"]), int(state["trained_at"])
        self._fresh_rows = int(state["fresh_rows"])


def _share_right(logits: Tensor, labels: Tensor) -> Tensor:
    """Return the accuracy; a positive logit means reachable."""
    return ((logits.detach() > 0) == (labels > 0.5)).float().mean()


def _decaying_weights(network: nn.Module, weight_decay: float) -> list[dict[str, Any]]:
    """Return two parameter groups: weights, which decay, and biases and batch normalisation, which do not."""
    matrices = [parameter for parameter in network.parameters() if parameter.ndim > 1]
    others = [parameter for parameter in network.parameters() if parameter.ndim <= 1]
    return [{"params": matrices, "weight_decay": weight_decay}, {"params": others}]
