"""RND: pays for observations on which a network cannot yet predict a fixed random one (Burda et al. 2019).

A target network of random weights gives features of each successor; a predictor learns to give the same. Its squared
error is large where little was seen. The bonus is bonus_weight times the error, divided by the running deviation of the
errors' discounted sum. That sum runs on across episodes, as in the source. Unlike there, both rewards have one value
function.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import prod
from typing import Any, ClassVar

import torch
from gymnasium import spaces
from torch import Tensor, nn
from torch.nn.utils import clip_grad_norm_

from sprl_baselines.bonus import Setting
from sprl_baselines.learning.config import Config, Count, Positive, Share, Weight, reject_more_than_rollout
from sprl_baselines.learning.images import image_shape, nature_convolutions
from sprl_baselines.learning.initialization import RELU_GAIN, linear
from sprl_baselines.learning.minibatches import Batch, Report, shuffled_minibatches, train
from sprl_baselines.learning.moments import RewardNormalizer
from sprl_baselines.learning.networks import mlp_trunk
from sprl_baselines.learning.observations import NormalizedObservations
from sprl_baselines.learning.rollout import Rollout, Rows
from sprl_baselines.learning.training_state import restore, saved


@dataclass(frozen=True)
class RNDConfig(Config):
    """Hyperparameters of RND; the paper of this benchmark has none for it."""

    bonus_weight: Weight = 0.01  # weight of the normalised error (our choice)
    rnd_gamma: Share = 0.99  # discount of the sum that errors are normalised by (the source's)
    rnd_learning_rate: Positive = 0.0001  # Adam's step size (the source's)
    rnd_max_grad_norm: Positive = 0.5  # longer gradients are cut to this length
    rnd_epochs: Count = 1  # passes over a rollout
    rnd_minibatches: Count = 4  # gradient steps in a pass
    rnd_units: Count = 256  # width of the hidden layers
    rnd_features: Count = 64  # numbers that are predicted
    rnd_clip: Positive = 5.0  # largest absolute value of a normalised number of an observation (the source's)

    def check_rollout(self, num_steps: int) -> None:
        """Refuse more minibatches than steps."""
        reject_more_than_rollout("rnd_minibatches", self.rnd_minibatches, num_steps)


class RND:
    """The predictor's normalised error as a bonus; nothing in the first rollout, which the normalisation starts from.

    Args:
        setting: Where it works.
        config: Hyperparameters.

    Raises:
        ValueError: Observations are no arrays of numbers.
    """

    privileged: ClassVar[bool] = False

    def __init__(self, setting: Setting, config: RNDConfig) -> None:
        if not isinstance(setting.observation_space, spaces.Box):
            raise ValueError(f"RND has no network for observations in {setting.observation_space}: it needs a Box.")
        self._config = config
        self._generator = torch.Generator(setting.device).manual_seed(setting.seed)
        initial = torch.Generator().manual_seed(setting.seed)
        self.network = Distillation(setting.observation_space, config, initial).to(setting.device)
        self._optimizer = torch.optim.Adam(self.network.predictor.parameters(), lr=config.rnd_learning_rate, fused=True)
        self._scale = RewardNormalizer(setting.num_envs, config.rnd_gamma, setting.device)

    def reward(self, rollout: Rollout) -> Tensor:
        """Return bonus_weight * error / deviation for each step's true successor, `[T, N]`."""
        if not self.network.view.count:
            return torch.zeros_like(rollout.rewards)
        return self._config.bonus_weight * self._errors(rollout) / self._scale.deviation

    def _errors(self, rollout: Rollout) -> Tensor:
        with torch.inference_mode():
            errors: Tensor = _successors(rollout).through(self.network)
        return errors.clone().view_as(rollout.rewards)

    def update(self, rollout: Rollout) -> Mapping[str, float]:
        """Take the rollout into the running moments, and train the predictor on it."""
        self.network.view.update(rollout.next_observations.flatten(0, 1).flatten(1))
        self._scale(self._errors(rollout), torch.zeros_like(rollout.ended))
        samples = Successors(_successors(rollout))
        config = self._config
        batches = shuffled_minibatches(samples, config.rnd_epochs, config.rnd_minibatches, self._generator)
        return {**train(self._gradient_step, batches), "rnd_deviation": self._scale.deviation}

    def _gradient_step(self, batch: Successors) -> Report:
        loss = batch.observations.through(self.network).mean()
        self._optimizer.zero_grad()
        loss.backward()
        clip_grad_norm_(self.network.predictor.parameters(), self._config.rnd_max_grad_norm)
        self._optimizer.step()
        return {"rnd_loss": loss.detach()}

    def state_dict(self) -> Mapping[str, Any]:
        """Return both networks, the optimizer's moments, the generator's state and the running moments."""
        return {**saved(self.network, self._optimizer, self._generator), "scale": self._scale.state_dict()}

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Take such a state."""
        restore(self.network, self._optimizer, self._generator, state)
        self._scale.load_state_dict(state["scale"])


@dataclass(frozen=True)
class Successors(Batch):
    """B observations to learn from, in any order."""

    observations: Rows  # [B] the true successors


def _successors(rollout: Rollout) -> Rows:
    """Return the true successor of every step, `[T * N]`."""
    transitions = rollout.transitions
    return Rows(transitions.distinct, transitions.places[:, 1])


class Distillation(nn.Module):
    """The fixed target, and the predictor, which is one layer deeper; for images, both begin with convolutions.

    Args:
        space: Of one observation.
        config: Sizes.
        generator: Source of the initial parameters, on the CPU.
    """

    def __init__(self, space: spaces.Box, config: RNDConfig, generator: torch.Generator) -> None:
        super().__init__()
        self.view = NormalizedObservations(prod(space.shape), config.rnd_clip)
        self.target = _network(space, 1, config, generator).requires_grad_(False)
        self.predictor = _network(space, 2, config, generator)

    def forward(self, observations: Tensor) -> Tensor:
        """Return the mean squared error of each of B observations, `[B]`."""
        seen = self.view(observations.flatten(1))
        errors: Tensor = (self.predictor(seen) - self.target(seen)).square().mean(dim=1)
        return errors


def _network(space: spaces.Box, layers: int, config: RNDConfig, generator: torch.Generator) -> nn.Sequential:
    """Return a network of flattened observations, `[B, D]` -> `[B, rnd_features]`."""
    convolutions: list[nn.Module] = []
    inputs = prod(space.shape)
    if image := image_shape(space):
        shaping = nn.Unflatten(1, space.shape)
        order = [shaping] if image.channels_first else [shaping, Permuted()]
        rest, inputs = nature_convolutions(image, generator)
        convolutions = [*order, *rest]
    dense = mlp_trunk(inputs, layers, config.rnd_units, generator)
    return nn.Sequential(*convolutions, dense, linear(config.rnd_units, config.rnd_features, RELU_GAIN, generator))


class Permuted(nn.Module):
    """Puts channels first."""

    def forward(self, images: Tensor) -> Tensor:
        """`[B, H, W, C]` -> `[B, C, H, W]`."""
        return images.permute(0, 3, 1, 2)
