"""ICM: the bonus is the prediction error of a learned forward model (Pathak et al. 2017).

Features phi of the observation are learned together with two models: a forward model predicts the successor's features
from the features and the action, and an inverse model infers the action from the features before and after it. Error
scale, clipping and weights follow the curiosity baseline of Savinov et al. (2019), as the paper's Tables 1 and 5 do.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import prod
from typing import Any, ClassVar, NamedTuple, Protocol

import torch
from gymnasium import Space, spaces
from torch import Tensor, nn
from torch.nn import functional
from torch.nn.utils import clip_grad_norm_

from sprl_baselines.bonus import Setting
from sprl_baselines.kernels.strided_convolution import CHANNELS, StridedConvolution
from sprl_baselines.learning.config import Config, Count, Positive, Share, Weight, reject_more_than_rollout
from sprl_baselines.learning.grids import GRIDS, grid_shape
from sprl_baselines.learning.images import IMAGES, Pixels, Shrunk, halving_convolutions, image_shape
from sprl_baselines.learning.initialization import RELU_GAIN, linear
from sprl_baselines.learning.minibatches import Batch, shuffled_minibatches, train
from sprl_baselines.learning.networks import ScaledCells, mlp_trunk
from sprl_baselines.learning.observations import RAW, View
from sprl_baselines.learning.rollout import Rollout, Rows
from sprl_baselines.learning.training_state import restore, saved

IMAGE_SIDE = 42  # pixels; images are resized, as in the published code
ERROR_SCALE = 0.5 * 288  # the published code has 288 features on its images, and this factor for all of them


@dataclass(frozen=True)
class ICMConfig(Config):
    """Hyperparameters of ICM."""

    bonus_weight: Weight = 0.1  # factor of the clipped error (Table 1)
    forward_share: Share = 0.8  # share of the forward loss; the rest is the inverse loss (Table 1)
    icm_loss_weight: Weight = 0.3  # factor of the model's loss (Table 1)
    icm_learning_rate: Positive = 0.003  # step size of the model's own Adam; the same as PPO's (Table 1)
    icm_adam_epsilon: Positive = 1e-5  # Adam's guard against division by zero
    icm_max_grad_norm: Positive = 0.5  # gradients with a larger norm are scaled down to it
    icm_epochs: Count = 4  # passes of the model over a rollout
    icm_minibatches: Count = 4  # its gradient steps in a pass
    icm_units: Count = 256  # width of the hidden layer of the forward and of the inverse model

    def check_rollout(self, num_steps: int) -> None:
        """Refuse more minibatches than transitions."""
        reject_more_than_rollout("icm_minibatches", self.icm_minibatches, num_steps)


class ICM:
    """The forward model's error as a bonus.

    It has no episodic memory. The last step of an episode counts like any other, with its true successor.

    Args:
        setting: Observations must be grids, images or flat; actions discrete or flat.
        config: Hyperparameters.
    """

    privileged: ClassVar[bool] = False

    def __init__(self, setting: Setting, config: ICMConfig) -> None:
        self._config = config
        self._generator = torch.Generator(setting.device).manual_seed(setting.seed)
        self.network = Dynamics(
            setting.observation_space,
            setting.action_space,
            torch.Generator().manual_seed(setting.seed),
            view=setting.view,
            units=config.icm_units,
        ).to(setting.device)
        self._optimizer = torch.optim.Adam(
            self.network.parameters(), lr=config.icm_learning_rate, eps=config.icm_adam_epsilon, fused=True
        )

    def reward(self, rollout: Rollout) -> Tensor:
        """Return bonus_weight * min(error, 1), `[T, N]`."""
        with torch.no_grad():
            errors: Tensor = self.network(Transitions.of(rollout)).errors
        return self._config.bonus_weight * errors.clamp(max=1).view_as(rollout.rewards)

    def update(self, rollout: Rollout) -> Mapping[str, float]:
        """Train features and models on one rollout; return the means over all gradient steps."""
        config, transitions = self._config, Transitions.of(rollout)
        batches = shuffled_minibatches(transitions, config.icm_epochs, config.icm_minibatches, self._generator)
        return train(self._gradient_step, batches)

    def _gradient_step(self, batch: Transitions) -> dict[str, Tensor]:
        foreseen = self.network(batch)
        forward_loss = foreseen.errors.mean()
        inverse = self.network.kind.inverse_losses(foreseen.actions, batch.actions)
        share = self._config.forward_share
        loss = self._config.icm_loss_weight * (share * forward_loss + (1 - share) * inverse["inverse_loss"])
        self._optimizer.zero_grad()
        loss.backward()
        clip_grad_norm_(self.network.parameters(), self._config.icm_max_grad_norm)
        self._optimizer.step()
        variance = foreseen.features.var(dim=0, correction=0).mean()
        metrics = {"forward_loss": forward_loss, **inverse, "phi_variance": variance}
        return {name: value.detach() for name, value in metrics.items()}

    def state_dict(self) -> Mapping[str, Any]:
        """Return copies of the parameters, the optimizer's moments and the generator's state."""
        return saved(self.network, self._optimizer, self._generator)

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Restore such a state."""
        restore(self.network, self._optimizer, self._generator, state)


@dataclass(frozen=True)
class Transitions(Batch):
    """B steps to learn from, in any order."""

    observations: Rows  # [B, 2] each step's observation and its true successor
    actions: Tensor  # [B] or [B, A], as sampled from the policy

    @classmethod
    def of(cls, rollout: Rollout) -> Transitions:
        """Flatten a rollout."""
        return cls(rollout.transitions, rollout.actions.flatten(0, 1))


class Foresight(NamedTuple):
    """The models' predictions for B transitions."""

    errors: Tensor  # [B] of the forward model: 0.5 * 288 * mean squared difference over features
    actions: Tensor  # [B, A] the inverse model's logits, or its continuous actions
    features: Tensor  # [B, F] phi of the true successors


class Dynamics(nn.Module):
    """Features phi, separate from the policy's network, with the forward and the inverse model.

    Args:
        observation_space: Grids `[H, W, 3]` uint8, images, or a flat Box.
        action_space: Discrete (from 0), or a flat Box.
        generator: Generator of the initial parameters, on the CPU.
        view: What the features see of an observation.
        units: Width of the two models' hidden layers.

    Raises:
        ValueError: There is no model for such spaces.
    """

    def __init__(
        self,
        observation_space: Space[Any],
        action_space: Space[Any],
        generator: torch.Generator,
        *,
        view: View = RAW,
        units: int,
    ) -> None:
        super().__init__()
        self.view = view
        self.kind = action_kind(action_space)
        self.phi, features = encoder(observation_space, generator)
        self.forward_model = one_hidden_layer(features + self.kind.size, features, units, generator)
        self.inverse_model = one_hidden_layer(2 * features, self.kind.size, units, generator)

    def forward(self, transitions: Transitions) -> Foresight:
        """Compute the features and both models' predictions."""
        before, after = transitions.observations.through(lambda rows: self.phi(self.view(rows))).unbind(1)
        predicted = self.forward_model(torch.cat((before, self.kind.encode(transitions.actions)), dim=1))
        errors = ERROR_SCALE * (predicted - after).square().mean(dim=1)
        return Foresight(errors, self.inverse_model(torch.cat((before, after), dim=1)), after)


def one_hidden_layer(inputs: int, outputs: int, units: int, generator: torch.Generator) -> nn.Sequential:
    """Return two fully connected layers with a ReLU between them."""
    hidden, out = linear(inputs, units, RELU_GAIN, generator), linear(units, outputs, 1.0, generator)
    return nn.Sequential(hidden, nn.ReLU(inplace=True), out)


# ------------------------------------------------------------------------------------------ features


def encoder(space: Space[Any], generator: torch.Generator) -> tuple[nn.Sequential, int]:
    """Return the network phi for these observations, and its number of features."""
    if grid := grid_shape(space):
        height, width, frames = grid
        sides = height, width
        cells = ScaledCells(frames)
        layers: list[nn.Module] = [cells]
        for inputs in (cells.channels, CHANNELS, CHANNELS, CHANNELS):
            convolution = StridedConvolution(inputs, sides, RELU_GAIN, generator)
            layers += [convolution, nn.ELU()]
            sides = convolution.remaining
        return nn.Sequential(*layers, FlattenCells()), CHANNELS * prod(sides)
    if image := image_shape(space):
        convolutions, features = halving_convolutions(image.channels, (IMAGE_SIDE, IMAGE_SIDE), generator)
        return nn.Sequential(Pixels(image), Shrunk(IMAGE_SIDE), *convolutions), features
    if isinstance(space, spaces.Box) and len(space.shape) == 1:
        size = space.shape[0]
        return mlp_trunk(size, 4, size, generator), size
    raise ValueError(f"observation_space is {space}; it must be {GRIDS}, {IMAGES}, or a flat Box.")


class FlattenCells(nn.Module):
    """Flattens each image cell by cell, without a copy if memory is channels-last."""

    def forward(self, images: Tensor) -> Tensor:
        """`[B, C, H, W]` -> `[B, H * W * C]`."""
        return images.permute(0, 2, 3, 1).flatten(1)


# ------------------------------------------------------------------------------------------- actions


class ActionKind(Protocol):
    """How the forward model takes actions, and the loss of the inverse model."""

    size: int  # numbers that encode an action

    def encode(self, actions: Tensor) -> Tensor:
        """Return actions as numbers, `[B, size]`."""

    def inverse_losses(self, answers: Tensor, actions: Tensor) -> dict[str, Tensor]:
        """Return `inverse_loss` and other metrics of the answers `[B, size]`."""


class DiscreteActions:
    """The forward model takes one-hot actions; the inverse model returns logits."""

    def __init__(self, count: int) -> None:
        self.size = count

    def encode(self, actions: Tensor) -> Tensor:
        """Return one-hot actions, `[B]` -> `[B, count]`."""
        return functional.one_hot(actions, self.size).float()

    def inverse_losses(self, answers: Tensor, actions: Tensor) -> dict[str, Tensor]:
        """Return the cross-entropy and the accuracy."""
        right = answers.argmax(dim=1) == actions
        return {"inverse_loss": functional.cross_entropy(answers, actions), "inverse_accuracy": right.float().mean()}


class ContinuousActions:
    """Both models use actions as the policy sampled them, not clipped."""

    def __init__(self, size: int) -> None:
        self.size = size

    def encode(self, actions: Tensor) -> Tensor:
        """Return the actions, `[B, size]`."""
        return actions

    def inverse_losses(self, answers: Tensor, actions: Tensor) -> dict[str, Tensor]:
        """Return the mean squared error."""
        return {"inverse_loss": (answers - actions).square().mean()}


def action_kind(space: Space[Any]) -> ActionKind:
    """Return the kind for this action space."""
    match space:
        case spaces.Discrete(n=count, start=0):
            return DiscreteActions(int(count))
        case spaces.Box(shape=(size,)):
            return ContinuousActions(size)
        case _:
            raise ValueError(f"action_space is {space}; it must be Discrete (from 0) or a flat Box.")
