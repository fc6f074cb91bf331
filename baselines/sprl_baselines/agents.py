"""An agent is PPO trained on reward plus bonus. This is the only file that combines the two."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Generic, TypeVar

import numpy as np
import torch
from gymnasium import Space
from gymnasium.vector import VectorEnv

from sprl_baselines import presets
from sprl_baselines.bonus import Bonus, NoBonus, NoBonusConfig, Setting
from sprl_baselines.count import Count, CountConfig
from sprl_baselines.eco import ECO, ECOConfig
from sprl_baselines.gt_grid import GTGrid, GTGridConfig
from sprl_baselines.icm import ICM, ICMConfig
from sprl_baselines.learning.collector import Collector, clipping, stacked
from sprl_baselines.learning.config import Config, reject_unknown
from sprl_baselines.learning.moments import RewardNormalizer
from sprl_baselines.learning.observations import View, view_of
from sprl_baselines.learning.rollout import Rollout
from sprl_baselines.learning.training_state import load_weights
from sprl_baselines.ppo import PPO, PPOConfig
from sprl_baselines.presets.ranges import RANGES
from sprl_baselines.rnd import RND, RNDConfig
from sprl_baselines.sprl import SPRL, ConstraintConfig, SPRLConfig

C = TypeVar("C", bound=Config)
Envs = VectorEnv[Any, Any, Any]


class LearningAgent:
    """PPO with a bonus.

    The agent does not change torch's number of threads or its handling of denormal numbers: the process sets both.

    Args:
        config: Hyperparameters of the learner.
        make_bonus: Makes the bonus once the spaces are known.
        seed: Seed of all random choices.
        device: Where to compute, such as "cpu" or "cuda".
    """

    def __init__(
        self, config: PPOConfig, make_bonus: Callable[[Setting], Bonus], *, seed: int, device: str = "cpu"
    ) -> None:
        self.config = config
        self._make_bonus = make_bonus
        self._seed = seed
        self._device = torch.device(device)
        self._saved: Mapping[str, Any] = {}

    def train(self, envs: Envs, budget: int) -> Iterator[dict[str, float]]:
        """Train until `budget` env steps are taken, and yield metrics after each update.

        Starts from the seed, or continues from a loaded state without resetting the envs.

        Raises:
            ValueError: `num_envs` of the envs differs from the hyperparameter, or the autoreset mode is not SameStep.
        """
        self._start(envs)
        while self._steps < budget:
            yield self._improve(remaining=1 - self._steps / budget)

    def _improve(self, remaining: float) -> dict[str, float]:
        """Collect one rollout and learn from it."""
        rollout = self._collector.collect(self.learner.policy(), self.learner.values)
        newest = rollout.newest(self.config.stack)
        bonus = self.bonus.reward(newest)
        learner_metrics = self.learner.update(rollout, self._training_rewards(rollout, bonus), remaining)
        bonus_metrics = self.bonus.update(newest)
        self._view.update(newest.observations)
        self._steps += rollout.num_steps
        own_metrics = {"bonus": float(bonus.mean()), "reward_deviation": self._normalizer.deviation}
        return {**own_metrics, **learner_metrics, **bonus_metrics}

    def _training_rewards(self, rollout: Rollout, bonus: torch.Tensor) -> torch.Tensor:
        """Return the training rewards, `[T, N]`: reward plus bonus, in a new tensor."""
        match self.config.reward_normalization:
            case "extrinsic":
                return self._normalizer(rollout.rewards, rollout.ended) + bonus
            case "joint":
                return self._normalizer(rollout.rewards + bonus, rollout.ended)
            case _:
                limit = self.config.reward_clip or torch.inf
                return rollout.rewards.clamp(-limit, limit) + bonus

    def _start(self, envs: Envs) -> None:
        if envs.num_envs != self.config.num_envs:
            raise ValueError(
                f"num_envs of the vector env is {envs.num_envs}; it must be {self.config.num_envs}, the hyperparameter."
            )
        spaces = envs.single_observation_space, envs.single_action_space
        learner_seed, bonus_seed, noise_seed = map(int, np.random.SeedSequence(self._seed).generate_state(3))
        self._view = self._make_view(spaces[0])
        observed = stacked(spaces[0], self.config.stack)
        action_time = float(envs.metadata.get("action_time", 1.0))
        config = self.config.timed(action_time)
        self.learner = PPO(observed, spaces[1], config, learner_seed, self._device, self._view)
        self.bonus = self._make_bonus(
            Setting(*spaces, envs.num_envs, bonus_seed, self._device, self._view, action_time)
        )
        self._normalizer = RewardNormalizer(envs.num_envs, config.gamma, self._device, config.reward_clip)
        self._collector = Collector(
            envs,
            self.config.rollout_length,
            self._device,
            action_noise=self.config.action_noise,
            seed=noise_seed,
            stack=self.config.stack,
        )
        self._steps = 0
        if self._saved:
            self._continue_from(self._saved)
        else:
            self._collector.reset()

    def _make_view(self, space: Space[Any]) -> View:
        config = self.config
        view = view_of(space, normalize=config.normalize_observations, clip=config.observation_clip)
        return view.to(self._device)

    def _continue_from(self, state: Mapping[str, Any]) -> None:
        """Restore a state.

        Raises:
            ValueError: It is not one of this agent in this build of the package.
        """
        try:
            self._restore(state)
        except torch.OutOfMemoryError:  # says nothing about the state
            raise
        except (LookupError, ValueError, TypeError, AttributeError, RuntimeError) as error:
            cause = " ".join(f"{type(error).__name__}: {error}".split())
            raise ValueError(
                f"The agent's state in the checkpoint is of another agent or build ({cause}). Continue with that one, "
                "or remove the checkpoint to start over."
            ) from error

    def _restore(self, state: Mapping[str, Any]) -> None:
        self._steps = int(state["steps"])
        self.learner.load_state_dict(state["learner"])
        self.bonus.load_state_dict(state["bonus"])
        self._normalizer.load_state_dict(state["normalizer"])
        self._collector.load_state_dict(state["collector"])

    def state_dict(self) -> dict[str, Any]:
        """Return everything that the rest of training depends on. Call it between two updates.

        Raises:
            RuntimeError: Training has not started, so there is no state.
        """
        self._require_begun()
        return {
            "steps": self._steps,
            "learner": self.learner.state_dict(),
            "bonus": self.bonus.state_dict(),
            "normalizer": self._normalizer.state_dict(),
            "collector": self._collector.state_dict(),
        }

    def _require_begun(self) -> None:
        if not hasattr(self, "_steps"):
            raise RuntimeError("The agent has no state before train() has started.")

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Set the state that `train` continues from and `policy` acts with.

        Raises:
            TypeError: It is no mapping.
        """
        if not isinstance(state, Mapping):
            raise TypeError(f"The agent's state is a {type(state).__name__}; it must be a mapping.")
        self._saved = state

    def weights(self) -> dict[str, Any]:
        """Return the network's parameters, as the part of a state that `policy` needs."""
        self._require_begun()
        bonus = {"bonus": self.bonus.weights()} if isinstance(self.bonus, SPRL) else {}
        return {"learner": {"network": self.learner.state_dict()["network"]}, **bonus}

    def costs(self, observation_space: Space[Any], action_space: Space[Any]) -> Callable[[Any], Any]:
        """Return a function from the observations of a stretch `[T + 1, ...]` to the cost of each step `[T]`.

        Raises:
            ValueError: The agent has no cost, or the weights are of another network, or of an earlier build.
            RuntimeError: The agent has no parameters yet.
        """
        view = self._make_view(observation_space)
        bonus = self._make_bonus(Setting(observation_space, action_space, 1, 0, self._device, view))
        if not isinstance(bonus, SPRL):
            raise ValueError("This agent charges no cost; it must be sprl or gt-sprl.")
        weights = self._saved or self.weights()
        if "bonus" not in weights:
            raise ValueError("The weights hold no reachability network; they must be of this build or a later one.")
        bonus.load_weights(weights["bonus"])
        return lambda observations: bonus.costs(torch.from_numpy(observations).to(self._device)).cpu().numpy()

    def policy(self, observation_space: Space[Any], action_space: Space[Any], seed: int) -> Callable[[Any], Any]:
        """Return a function from one observation of a single environment to an action, sampled as in training.

        Raises:
            ValueError: The agent needs more than one observation at a time, or the weights are of another network.
            RuntimeError: The agent has no parameters yet.
        """
        if self.config.stack:
            raise ValueError(f"Hyperparameter stack is {self.config.stack}; it must be 0 to act on one observation.")
        view = self._make_view(observation_space)
        learner = PPO(observation_space, action_space, self.config, seed, self._device, view)
        load_weights(learner.network, (self._saved or self.weights())["learner"]["network"])
        draw, clipped = learner.policy(), clipping(action_space)

        def act(observation: Any) -> Any:
            with torch.inference_mode():
                action = draw(torch.from_numpy(observation[None]).to(self._device)).actions[0].cpu().numpy()
            return clipped(action)

        return act


@dataclass(frozen=True)
class LearningAgentFactory(Generic[C]):
    """Makes the agents of one method: a bonus class and its hyperparameters."""

    name: str
    bonus: Callable[[Setting, C], Bonus]
    bonus_config: type[C]
    privileged: bool = False
    default_preset: ClassVar[str] = "table"

    def __call__(self, *, seed: int, device: str = "cpu", **hyperparameters: Any) -> LearningAgent:
        """Make an agent. Missing hyperparameters have their defaults.

        Raises:
            ValueError: A hyperparameter is unknown or out of range.
        """
        config, bonus_config = self._configs(hyperparameters)
        return LearningAgent(config, lambda setting: self.bonus(setting, bonus_config), seed=seed, device=device)

    def hyperparameters(
        self, domain: str, overrides: Mapping[str, Any], preset: str = default_preset
    ) -> dict[str, Any]:
        """Return all hyperparameters: the defaults, then the domain's preset, then `overrides`.

        Args:
            domain: A family of tasks, such as "grid".
            overrides: Single hyperparameters.
            preset: The name of one of the domain's presets.

        Raises:
            ValueError: The domain, the preset or a hyperparameter is unknown, or a value is out of range.
        """
        config, bonus_config = self._configs({**presets.preset(domain, preset, self.name), **overrides})
        return {**config.as_dict(), **bonus_config.as_dict()}

    def ranges(self, domain: str) -> Mapping[str, Sequence[Any]]:
        """Return what the paper swept over for this agent on a domain; empty where it has nothing."""
        return RANGES[domain].get(self.name, {})

    def wait(self, hyperparameters: Mapping[str, Any]) -> int:
        """Return the env steps before which the bonus is 0 whatever its hyperparameters are."""
        config, bonus_config = self._configs(hyperparameters)
        return bonus_config.wait(config.num_envs, config.rollout_length)

    def _configs(self, values: Mapping[str, Any]) -> tuple[PPOConfig, C]:
        reject_unknown("hyperparameter", values, PPOConfig.names() + self.bonus_config.names())
        config, bonus_config = PPOConfig.pick(values), self.bonus_config.pick(values)
        bonus_config.check_rollout(config.num_envs * config.rollout_length)
        return config, bonus_config


count = LearningAgentFactory("count", Count, CountConfig, privileged=Count.privileged)
eco = LearningAgentFactory("eco", ECO, ECOConfig)
gt_grid = LearningAgentFactory("gt-grid", GTGrid, GTGridConfig, privileged=GTGrid.privileged)
gt_sprl = LearningAgentFactory("gt-sprl", SPRL.true, ConstraintConfig, privileged=True)
icm = LearningAgentFactory("icm", ICM, ICMConfig)
ppo = LearningAgentFactory("ppo", NoBonus, NoBonusConfig)
rnd = LearningAgentFactory("rnd", RND, RNDConfig)
sprl = LearningAgentFactory("sprl", SPRL.learned, SPRLConfig)
