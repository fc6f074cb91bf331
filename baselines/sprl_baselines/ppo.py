"""Proximal policy optimisation (Schulman et al. 2017): the policy learner of all agents.

It learns from the training rewards that it is given and does not know about bonuses. The paper's appendix gives the
network, the learning rate and the entropy coefficient (D.3, Table 1). The other settings are those that the authors
published for DeepMind Lab, except where a sweep decided (`notes/ppo-sweep.md`).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Annotated, Any

import torch
from gymnasium import Space
from torch import Tensor
from torch.nn.utils import clip_grad_norm_

from sprl_baselines.learning.acting import acting
from sprl_baselines.learning.collector import Decision, Policy, Values
from sprl_baselines.learning.config import (
    Choice,
    Config,
    Count,
    Positive,
    Range,
    Share,
    Weight,
    reject_more_than_rollout,
)
from sprl_baselines.learning.minibatches import Batch, shuffled_minibatches, train
from sprl_baselines.learning.networks import actor_critic
from sprl_baselines.learning.observations import RAW, View
from sprl_baselines.learning.returns import generalized_advantages, successor_values
from sprl_baselines.learning.rollout import Rollout, Rows
from sprl_baselines.learning.training_state import restore, saved


@dataclass(frozen=True)
class PPOConfig(Config):
    """Hyperparameters of the learner."""

    num_envs: Count = 12  # sub-envs that step together
    rollout_length: Count = 128  # steps of each sub-env between two updates
    epochs: Count = 4  # passes over a rollout
    minibatches: Count = 4  # gradient steps in a pass
    learning_rate: Positive = 0.003  # Adam's step size (Table 1)
    anneal_learning_rate: bool = True  # let it fall linearly to 0 over the budget
    adam_epsilon: Positive = 1e-5  # Adam's guard against division by zero
    max_grad_norm: Positive = 0.5  # gradients with a larger norm are scaled down to it
    gamma: Share = 0.99  # discount
    gae_lambda: Share = 0.95  # advantage estimate: 0 for one-step errors, 1 for full returns
    # What gamma and gae_lambda are per: an env step, or the duration of a reference action (Fetch, substep 20).
    discount_per: Annotated[str, Choice("action", "reference-action")] = "action"
    bootstrap_on_truncation: bool = False  # whether truncated episodes use their successor's value
    clip_range: Positive = 0.2  # the loss gains nothing from probability ratios beyond 1 +- this
    anneal_clip_range: bool = True  # let it fall linearly to 0 over the budget
    clip_value: bool = True  # limit the change of the value by the same range
    value_coefficient: Weight = 0.5  # weight of the value loss, half the mean squared error
    entropy_coefficient: Weight = 0.01  # weight of the policy's entropy (Table 1)
    # Divide the env's reward ("extrinsic"), or reward plus bonus ("joint"), by the running standard deviation of its
    # discounted sum (appendix G.3).
    reward_normalization: Annotated[str, Choice("none", "extrinsic", "joint")] = "none"
    reward_clip: Weight = 0.0  # largest absolute value of the (normalised) reward of a step; 0 for no limit
    normalize_observations: bool = False  # by the running mean and standard deviation of each component
    observation_clip: Positive = 5.0  # largest absolute value of a normalised component
    action_noise: Weight = 0.0  # standard deviation of the noise added to continuous actions (Table 5)
    stack: Annotated[int, Range(0)] = 0  # earlier observations that the policy also sees (appendix A.3)
    mlp_layers: Count = 4  # hidden layers for flat observations (appendix G.4)
    mlp_units: Count = 256  # width of each

    def timed(self, action_time: float) -> PPOConfig:
        """Return the config with `gamma` and `gae_lambda` per env step, which lasts so many reference actions."""
        if self.discount_per == "action":
            return self
        return replace(self, gamma=self.gamma**action_time, gae_lambda=self.gae_lambda**action_time)

    def __post_init__(self) -> None:
        super().__post_init__()
        reject_more_than_rollout("minibatches", self.minibatches, self.num_envs * self.rollout_length)
        if self.normalize_observations and self.stack:
            raise ValueError(
                f"Hyperparameter stack is {self.stack}; it must be 0 where normalize_observations is true."
            )


class PPO:
    """A policy and a value function, and their training.

    Args:
        observation_space: Of one sub-env.
        action_space: Of one sub-env.
        config: Hyperparameters.
        seed: Seed of the initial parameters, the actions and the order of minibatches.
        device: Where to compute. On the CPU, the same seed and number of torch threads give bit-identical results.
        view: What the networks see of an observation.
    """

    def __init__(
        self,
        observation_space: Space[Any],
        action_space: Space[Any],
        config: PPOConfig,
        seed: int,
        device: torch.device,
        view: View = RAW,
    ) -> None:
        self.config = config
        self._generator = torch.Generator(device).manual_seed(seed)
        self.network = actor_critic(
            observation_space,
            action_space,
            torch.Generator().manual_seed(seed),
            view=view,
            mlp_layers=config.mlp_layers,
            mlp_units=config.mlp_units,
        ).to(device)
        self._optimizer = torch.optim.Adam(
            self.network.parameters(), lr=config.learning_rate, eps=config.adam_epsilon, fused=True
        )

    def policy(self) -> Policy:
        """Return a function that draws an action for each of N observations with the present parameters."""
        answer = acting(self.network)

        def act(observations: Tensor) -> Decision:
            parameters, values = answer(observations)
            distribution = self.network.head.distribution(parameters)
            actions = distribution.sample(self._generator)
            return Decision(actions, distribution.log_prob(actions), values)

        return act

    @property
    def values(self) -> Values | None:
        """What computes the values of a whole rollout, if the policy does not compute them while it acts."""
        return None if self.network.shared else self.network.values

    def update(self, rollout: Rollout, training_rewards: Tensor, remaining: float = 1.0) -> dict[str, float]:
        """Improve the policy on one rollout.

        Args:
            rollout: Collected with the current parameters.
            training_rewards: Rewards to learn from, `[T, N]`.
            remaining: Share of the budget that was left when the rollout began. Annealed settings are multiplied by it.

        Returns:
            Means over all gradient steps, and numbers about the rollout.
        """
        clip_range = self.config.clip_range * (remaining if self.config.anneal_clip_range else 1.0)
        learning_rate = self.config.learning_rate * (remaining if self.config.anneal_learning_rate else 1.0)
        for group in self._optimizer.param_groups:
            group["lr"] = learning_rate
        samples = self._samples(rollout, training_rewards)
        batches = shuffled_minibatches(samples, self.config.epochs, self.config.minibatches, self._generator)
        return {
            **train(lambda batch: self._gradient_step(batch, clip_range), batches),
            "explained_variance": _explained_variance(samples.values, samples.returns),
            "learning_rate": learning_rate,
            "clip_range": clip_range,
        }

    def _samples(self, rollout: Rollout, training_rewards: Tensor) -> Samples:
        """Flatten a rollout to T x N samples, with advantages and value targets."""
        advantages = generalized_advantages(
            training_rewards,
            rollout.values,
            self._successor_values(rollout),
            rollout.terminated,
            rollout.truncated,
            gamma=self.config.gamma,
            gae_lambda=self.config.gae_lambda,
            bootstrap_on_truncation=self.config.bootstrap_on_truncation,
        )
        return Samples(
            observations=rollout.observed,
            actions=rollout.actions.flatten(0, 1),
            log_probs=rollout.log_probs.flatten(),
            values=rollout.values.flatten(),
            advantages=advantages.flatten(),
            returns=(advantages + rollout.values).flatten(),
        )

    def _successor_values(self, rollout: Rollout) -> Tensor:
        with torch.inference_mode():
            last_values = self.network.values(rollout.last_observations)
            final_values = self._final_values(rollout.final_observations)
        return successor_values(rollout.values, last_values, rollout.ended, final_values)

    def _final_values(self, final_observations: Tensor) -> Tensor:
        """Return the values of the observations that ended an episode; zeros where they are not used."""
        if self.config.bootstrap_on_truncation and len(final_observations):
            return self.network.values(final_observations)
        return torch.zeros(len(final_observations), device=final_observations.device)

    def _gradient_step(self, batch: Samples, clip_range: float) -> dict[str, Tensor]:
        parameters, values = batch.observations.through(self.network)
        distribution = self.network.head.distribution(parameters)
        log_probs, entropy = distribution.log_prob(batch.actions), distribution.entropy()
        losses = ppo_losses(log_probs, values, entropy, batch.normalized(), clip_range, self.config)
        self._optimizer.zero_grad()
        losses.pop("loss").backward()  # type: ignore[no-untyped-call] # torch has no types there
        norm = clip_grad_norm_(self.network.parameters(), self.config.max_grad_norm)
        self._optimizer.step()
        return {**losses, "gradient_norm": norm}

    def state_dict(self) -> dict[str, Any]:
        """Return copies of the parameters, the optimizer's moments and the generator's state."""
        return saved(self.network, self._optimizer, self._generator)

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Restore such a state."""
        restore(self.network, self._optimizer, self._generator, state)


@dataclass(frozen=True)
class Samples(Batch):
    """B transitions to learn from, in any order."""

    observations: Rows  # [B]
    actions: Tensor  # [B] or [B, A]
    log_probs: Tensor  # [B] under the policy that collected them
    values: Tensor  # [B] when they were collected
    advantages: Tensor  # [B]
    returns: Tensor  # [B] targets of the value function

    def normalized(self) -> Samples:
        """Return the same with advantages of zero mean and unit standard deviation, if there is more than one."""
        if len(self) == 1:
            return self
        advantages = (self.advantages - self.advantages.mean()) / (self.advantages.std() + 1e-8)
        return replace(self, advantages=advantages)


def ppo_losses(
    log_probs: Tensor, values: Tensor, entropy: Tensor, batch: Samples, clip_range: float, config: PPOConfig
) -> dict[str, Tensor]:
    """Return the clipped surrogate loss, its parts, and two measures of how far the policy has moved.

    Args:
        log_probs: Log-probabilities of the batch's actions under the current policy, `[B]`.
        values: Current values of the batch's observations, `[B]`.
        entropy: Entropy of the current policy, `[B]`.
        batch: Samples, with normalised advantages, and the values and log-probabilities of when they were collected.
        clip_range: The loss gains nothing from probability ratios beyond 1 +- this.
        config: Coefficients and switches.

    Returns:
        Scalars: `loss` with its gradient; `policy_loss`, `value_loss`, `entropy`, `approximate_kl` and
        `clipped_share` without.
    """
    log_ratio = log_probs - batch.log_probs
    ratio = log_ratio.exp()
    policy_loss = _policy_loss(ratio, batch.advantages, clip_range)
    value_loss = _value_loss(values, batch, clip_range if config.clip_value else torch.inf)
    mean_entropy = entropy.mean()
    loss = policy_loss + config.value_coefficient * value_loss - config.entropy_coefficient * mean_entropy
    with torch.no_grad():
        return {
            "loss": loss,
            "policy_loss": policy_loss.detach(),
            "value_loss": value_loss.detach(),
            "entropy": mean_entropy.detach(),
            "approximate_kl": (ratio - 1 - log_ratio).mean(),
            "clipped_share": ((ratio - 1).abs() > clip_range).float().mean(),
        }


def _policy_loss(ratio: Tensor, advantages: Tensor, clip_range: float) -> Tensor:
    """Return minus the mean of the smaller of the plain and the clipped surrogate."""
    clipped = ratio.clamp(1 - clip_range, 1 + clip_range)
    return -torch.minimum(ratio * advantages, clipped * advantages).mean()


def _value_loss(values: Tensor, batch: Samples, clip_range: float) -> Tensor:
    """Return half the mean of the larger of the plain and the clipped squared error."""
    clipped = batch.values + (values - batch.values).clamp(-clip_range, clip_range)
    return 0.5 * torch.maximum((values - batch.returns).square(), (clipped - batch.returns).square()).mean()


def _explained_variance(values: Tensor, returns: Tensor) -> float:
    """Return the share of the returns' variance that the values explain, at most 1; 0 if the returns are constant."""
    variance = returns.var()
    return float(1 - (returns - values).var() / variance) if variance > 0 else 0.0
