"""ICM: pays for what a learned model of the dynamics does not foresee (Pathak et al. 2017).

Features phi of the observation are learned together with two models on them: a forward model that predicts the
successor's features from the action, and an inverse model that infers the action from both. The bonus is the forward
model's error. Error scale, clipping and weights follow the curiosity baseline of Savinov et al. (2019), as the paper's
Tables 1 and 5 do.
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
from sprl_baselines.learning.config import Config, Count, Positive, Share, Weight
from sprl_baselines.learning.grids import GRIDS, grid_shape
from sprl_baselines.learning.minibatches import Batch, shuffled_minibatches, train
from sprl_baselines.learning.networks import RELU_GAIN, ScaledCells, linear, mlp_trunk
from sprl_baselines.learning.observations import RAW, View
from sprl_baselines.learning.rollout import Rollout, Rows
from sprl_baselines.learning.training_state import restore, saved

ERROR_SCALE = 0.5 * 288  # 288: the number of features that the published code has, and multiplies by everywhere


@dataclass(frozen=True)
class ICMConfig(Config):
    """Hyperparameters of ICM."""

    bonus_weight: Weight = 0.1  # what the clipped error is multiplied by (Table 1)
    forward_share: Share = 0.8  # of the forward loss in the model's loss; the rest is the inverse loss (Table 1)
    icm_loss_weight: Weight = 0.3  # multiplies the model's loss before its gradient is cut (Table 1)
    icm_learning_rate: Positive = 0.003  # step size of the model's own Adam: PPO's (Table 1)
    icm_adam_epsilon: Positive = 1e-5  # its guard against division by zero
    icm_max_grad_norm: Positive = 0.5  # longer gradients of the model are cut to this length
    icm_epochs: Count = 4  # passes of the model over a rollout
    icm_minibatches: Count = 4  # its gradient steps in a pass
    icm_units: Count = 256  # width of the hidden layer of the forward and of the inverse model

    def check_rollout(self, num_steps: int) -> None:
        """Refuse more minibatches than transitions."""
        if self.icm_minibatches > num_steps:
            raise ValueError(
                f"Hyperparameter icm_minibatches={self.icm_minibatches} must be at most num_envs * rollout_length, "
                f"{num_steps}."
            )


class ICM:
    """The forward model's error as a bonus.

    It remembers nothing of an episode, and a step that ends one is like any other: its successor is the true one.

    Args:
        setting: Where it works.
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
        """Return weight * clip(error, -1, 1), `[T, N]`; no error is below 0."""
        with torch.no_grad():
            errors: Tensor = self.network(Transitions.of(rollout)).errors
        return self._config.bonus_weight * errors.clamp(max=1).view_as(rollout.rewards)

    def update(self, rollout: Rollout) -> Mapping[str, float]:
        """Train features and models on one rollout; return means over all gradient steps.

        Raises:
            ValueError: There are more minibatches than transitions.
        """
        config, transitions = self._config, Transitions.of(rollout)
        config.check_rollout(len(transitions))
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
        """Return parameters, optimizer moments and the generator's state, copied."""
        return saved(self.network, self._optimizer, self._generator)

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Take such a state."""
        restore(self.network, self._optimizer, self._generator, state)


@dataclass(frozen=True)
class Transitions(Batch):
    """B steps to learn from, in any order."""

    observations: Rows  # [B, 2] each step's observation and its true successor
    actions: Tensor  # [B] or [B, A], as drawn from the policy

    @classmethod
    def of(cls, rollout: Rollout) -> Transitions:
        """Flatten a rollout."""
        return cls(rollout.transitions, rollout.actions.flatten(0, 1))


class Foresight(NamedTuple):
    """What the models made of B transitions."""

    errors: Tensor  # [B] of the forward model, 0.5 * 288 * the mean squared difference over features
    actions: Tensor  # [B, A] logits, or the actions themselves, as the inverse model infers them
    features: Tensor  # [B, F] phi of the true successors


class Dynamics(nn.Module):
    """Features phi, which the policy has no part in, with the forward and the inverse model.

    Args:
        observation_space: Grids `[H, W, 3]` uint8, or a flat Box.
        action_space: Discrete (from 0), or a flat Box.
        generator: Source of the initial parameters, on the CPU.
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
        """Compute the features, and both models' answers."""
        before, after = transitions.observations.through(lambda rows: self.phi(self.view(rows))).unbind(1)
        predicted = self.forward_model(torch.cat((before, self.kind.encode(transitions.actions)), dim=1))
        errors = ERROR_SCALE * (predicted - after).square().mean(dim=1)
        return Foresight(errors, self.inverse_model(torch.cat((before, after), dim=1)), after)


def one_hidden_layer(inputs: int, outputs: int, units: int, generator: torch.Generator) -> nn.Sequential:
    """Two fully connected layers with a ReLU between."""
    hidden, out = linear(inputs, units, RELU_GAIN, generator), linear(units, outputs, 1.0, generator)
    return nn.Sequential(hidden, nn.ReLU(inplace=True), out)


# ------------------------------------------------------------------------------------------ features


def encoder(space: Space[Any], generator: torch.Generator) -> tuple[nn.Sequential, int]:
    """The network phi for such observations, and its number of features."""
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
    if isinstance(space, spaces.Box) and len(space.shape) == 1:
        size = space.shape[0]
        return mlp_trunk(size, 4, size, generator), size
    raise ValueError(f"ICM has no features for observations in {space}: need {GRIDS} or a flat Box.")


class FlattenCells(nn.Module):
    """One row of features per image, cell by cell: a view where memory is channels-last."""

    def forward(self, images: Tensor) -> Tensor:
        """`[B, C, H, W]` -> `[B, H * W * C]`."""
        return images.permute(0, 2, 3, 1).flatten(1)


# ------------------------------------------------------------------------------------------- actions


class ActionKind(Protocol):
    """How actions enter the forward model, and how the inverse model's answer is judged."""

    size: int  # numbers that stand for an action

    def encode(self, actions: Tensor) -> Tensor:
        """Actions as numbers, `[B, size]`."""

    def inverse_losses(self, answers: Tensor, actions: Tensor) -> dict[str, Tensor]:
        """`inverse_loss`, and other measures, of the answers `[B, size]`."""


class DiscreteActions:
    """One-hot in, logits out."""

    def __init__(self, count: int) -> None:
        self.size = count

    def encode(self, actions: Tensor) -> Tensor:
        """`[B]` -> `[B, count]`."""
        return functional.one_hot(actions, self.size).float()

    def inverse_losses(self, answers: Tensor, actions: Tensor) -> dict[str, Tensor]:
        """Cross-entropy, and the share of actions that were told right."""
        right = answers.argmax(dim=1) == actions
        return {"inverse_loss": functional.cross_entropy(answers, actions), "inverse_accuracy": right.float().mean()}


class ContinuousActions:
    """Actions as the policy drew them, in and out."""

    def __init__(self, size: int) -> None:
        self.size = size

    def encode(self, actions: Tensor) -> Tensor:
        """`[B, size]` -> `[B, size]`."""
        return actions

    def inverse_losses(self, answers: Tensor, actions: Tensor) -> dict[str, Tensor]:
        """Squared error, mean over components."""
        return {"inverse_loss": (answers - actions).square().mean()}


def action_kind(space: Space[Any]) -> ActionKind:
    """The kind for this action space."""
    match space:
        case spaces.Discrete(n=count, start=0):
            return DiscreteActions(int(count))
        case spaces.Box(shape=(size,)):
            return ContinuousActions(size)
        case _:
            raise ValueError(f"ICM has no model for actions in {space}: need Discrete (from 0) or a flat Box.")
