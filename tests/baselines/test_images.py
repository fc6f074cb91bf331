"""Agents on images: the published networks, and every agent on made-up ones, channels first and last."""

from __future__ import annotations

import copy
from collections.abc import Callable
from typing import Any

import gymnasium
import numpy as np
import pytest
import torch
from gymnasium import spaces
from gymnasium.vector import AutoresetMode, SyncVectorEnv
from torch import Tensor, nn
from torch.nn import functional

from sprl_baselines import agents
from sprl_baselines.icm import encoder
from sprl_baselines.learning.collector import stacked
from sprl_baselines.learning.images import ImageShape, Pixels, image_shape
from sprl_baselines.learning.networks import actor_critic
from sprl_baselines.presets import preset
from sprl_baselines.reachability import LARGE
from sprl_baselines.reachability.network import ReachabilityNetwork, reachability_network
from sprl_baselines.reachability.residual import SMALL

ATARI = spaces.Box(0, 255, (4, 84, 84), np.uint8)
MAZE = spaces.Box(0, 255, (84, 84, 3), np.uint8)
SPACES = {"atari": ATARI, "dmlab": MAZE}
TINY = {"atari": spaces.Box(0, 255, (4, 40, 36), np.uint8), "dmlab": spaces.Box(0, 255, (36, 40, 3), np.uint8)}
NAMES = {
    "atari": ("eco", "icm", "ppo", "rnd", "sprl"),
    "dmlab": ("eco", "gt-grid", "icm", "ppo", "rnd", "sprl"),
}
# So small that a network trains, and is used, within a few rollouts.
SHORT: dict[str, Any] = {"num_envs": 2, "rollout_length": 8, "epochs": 1, "minibatches": 1}
SHORT_ICM = {"icm_epochs": 1, "icm_minibatches": 1}
SHORT_RND = {"rnd_epochs": 1, "rnd_minibatches": 1}
SHORT_NETWORK = {
    "k": 1,
    "negative_bias": 1,
    "positive_bias": 1,
    "replay_size": 32,
    "train_every": 16,
    "max_pairs": 8,
    "pair_batch": 4,
    "ready_trainings": 1,
    "ready_accuracy": 0.0,
    "accuracy_pairs": 4,
    "head_units": 8,
    "embedding_units": 8,
}
EXTRA = {
    "icm": SHORT_ICM,
    "rnd": SHORT_RND,
    "eco": {**SHORT_NETWORK, "memory_size": 4},
    "sprl": {**SHORT_NETWORK, "tolerance_samples": 2},
}


class Dot(gymnasium.Env[Any, Any]):
    """A bright dot that walks left and right; at the right edge it earns 7 points. It reports its position."""

    def __init__(self, space: spaces.Box) -> None:
        self.observation_space, self.action_space = space, spaces.Discrete(3)

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> Any:
        super().reset(seed=seed)
        self._place, self._time = int(self.np_random.integers(5)), 0
        return self._look()

    def _look(self) -> tuple[Any, dict[str, Any]]:
        image = np.zeros(self.observation_space.shape, np.uint8)
        assert image.ndim == 3
        x = self._place
        if image.shape[0] < image.shape[2]:
            image[:, 4:8, 6 * x : 6 * x + 6] = 200
        else:
            image[4:8, 6 * x : 6 * x + 6] = 200
        return image, {"is_success": False, "position": np.array([31.0 * x, -50.0])}

    def step(self, action: int) -> Any:
        self._place = int(np.clip(self._place + action - 1, 0, 5))
        self._time += 1
        image, info = self._look()
        return image, 7.0 * (self._place == 5), self._place == 5, self._time == 12, info


def _envs(domain: str) -> SyncVectorEnv:
    makers: list[Callable[[], Dot]] = [lambda: Dot(TINY[domain])] * 2
    envs = SyncVectorEnv(makers, autoreset_mode=AutoresetMode.SAME_STEP)
    envs.reset(seed=3)
    return envs


def _agent(name: str, domain: str, device: str = "cpu", **changes: Any) -> Any:
    factory = getattr(agents, name.replace("-", "_"))
    resolved = factory.hyperparameters(domain, {**SHORT, **EXTRA.get(name, {}), **changes})
    return factory(seed=0, device=device, **resolved)


def seeded(seed: int = 0) -> torch.Generator:
    return torch.Generator().manual_seed(seed)


def _images(space: spaces.Box, count: int) -> Tensor:
    return torch.randint(0, 256, (count, *space.shape), generator=seeded(1)).to(torch.uint8)


# ------------------------------------------------------------------------------------------ networks


@pytest.mark.parametrize(
    ("shape", "found"),
    [
        ((4, 84, 84), ImageShape(4, 84, 84, True)),
        ((84, 84, 3), ImageShape(3, 84, 84, False)),
        ((120, 160, 3), ImageShape(3, 120, 160, False)),
        ((7, 7, 3), None),
        ((84, 30, 3), None),
        ((84, 84), None),
    ],
)
def test_images_are_told_by_their_shape(shape: tuple[int, ...], found: ImageShape | None) -> None:
    assert image_shape(spaces.Box(0, 255, shape, np.uint8)) == found
    assert image_shape(spaces.Box(0, 255, shape, np.float32)) is None


def test_pixels_are_divided_by_255_and_channels_come_first() -> None:
    first, last = _images(ATARI, 2), _images(MAZE, 2)
    torch.testing.assert_close(Pixels(ImageShape(4, 84, 84, True))(first), first / 255)
    torch.testing.assert_close(Pixels(ImageShape(3, 84, 84, False))(last), (last / 255).permute(0, 3, 1, 2))


@pytest.mark.parametrize("domain", sorted(SPACES))
def test_the_policy_network_is_that_of_mnih_et_al(domain: str) -> None:
    space = SPACES[domain]
    network = actor_critic(space, spaces.Discrete(18), seeded())
    shapes = [tuple(parameter.shape) for parameter in network.policy_trunk.parameters() if parameter.ndim > 1]
    channels = 4 if domain == "atari" else 3
    assert shapes == [(32, channels, 8, 8), (64, 32, 4, 4), (64, 64, 3, 3), (512, 3136)]
    images = _images(space, 3)
    pixels = images / 255 if domain == "atari" else (images / 255).permute(0, 3, 1, 2)
    weights = iter(network.policy_trunk.parameters())
    for stride in (4, 2, 1):
        pixels = functional.conv2d(pixels, next(weights), next(weights), stride).relu()
    features = functional.linear(pixels.flatten(1), next(weights), next(weights)).relu()
    parameters, values = network(images)
    torch.testing.assert_close(parameters, network.head(features))
    torch.testing.assert_close(values, network.value(features).squeeze(-1))
    torch.testing.assert_close(network.values(images), values)


@pytest.mark.parametrize("domain", sorted(SPACES))
def test_icm_sees_42_by_42_pixels_and_has_288_features(domain: str) -> None:
    phi, features = encoder(SPACES[domain], seeded())
    convolutions = [module for module in phi if isinstance(module, nn.Conv2d)]
    assert features == 288
    assert [(one.out_channels, one.kernel_size, one.stride) for one in convolutions] == [(32, (3, 3), (2, 2))] * 4
    images = _images(SPACES[domain], 2)
    assert phi(images).shape == (2, 288)
    shrunk = phi[:2](images)
    assert shrunk.shape[2:] == (42, 42)
    pixels = Pixels(image_shape(SPACES[domain]))(images)  # type: ignore[arg-type]
    torch.testing.assert_close(shrunk, functional.avg_pool2d(pixels, 2))


def _judge(space: spaces.Box, blocks: tuple[int, ...], pair_input: str = "pair") -> ReachabilityNetwork:
    return reachability_network(
        space, seeded(), embedding_units=512, layers=3, units=512, pair_input=pair_input, blocks=blocks
    )


@pytest.mark.parametrize(
    ("blocks", "convolutions", "widths"),
    [(SMALL, 11, [32, 64, 128]), (LARGE, 17, [64, 128, 256, 512])],
)
def test_the_reachability_network_is_the_residual_one(
    blocks: tuple[int, ...], convolutions: int, widths: list[int]
) -> None:
    """ResNet-12 has 11 convolutions and a layer of 512 units, ResNet-18 has 17 and a layer."""
    network = _judge(MAZE, blocks)
    inner = [module for module in network.embedding.modules() if isinstance(module, nn.Conv2d)]
    wide = [one for one in inner if one.kernel_size != (1, 1)]
    assert len(wide) == convolutions
    assert sorted({one.out_channels for one in inner}) == widths
    assert (wide[0].kernel_size, wide[0].stride) == ((7, 7), (2, 2))
    heads = [module for module in [network.first, *network.rest] if isinstance(module, nn.Linear)]
    assert [(one.in_features, one.out_features) for one in heads] == [(1024, 512), (512, 512), (512, 512), (512, 1)]


@pytest.mark.parametrize("pair_input", ["pair", "difference"])
def test_embedding_in_parts_changes_no_answer(pair_input: str, monkeypatch: pytest.MonkeyPatch) -> None:
    network = _judge(ATARI, SMALL, pair_input).eval()
    images, earlier, later = _images(ATARI, 7), torch.tensor([0, 1, 2, 3, 4]), torch.tensor([1, 2, 3, 6, 6])
    with torch.inference_mode():
        whole = network(images)(earlier, later)
        monkeypatch.setattr(network, "_at_once", 2)
        parts = network(images)(earlier, later)
    torch.testing.assert_close(parts, whole, rtol=1e-4, atol=1e-4)


def test_a_difference_is_taken_pixel_by_pixel() -> None:
    """Equal states have the difference 0, in whatever state; and uint8 does not wrap around."""
    network = _judge(ATARI, SMALL, "difference").eval()
    dark, bright = torch.zeros(1, 4, 84, 84, dtype=torch.uint8), torch.full((1, 4, 84, 84), 255, dtype=torch.uint8)
    seen: list[Tensor] = []
    network.embedding.register_forward_pre_hook(lambda _, inputs: seen.append(inputs[0]))
    with torch.inference_mode():
        network(torch.cat((dark, bright)))(torch.tensor([1, 0]), torch.tensor([0, 0]))
    assert seen[1].unique().tolist() == [-255.0, 0.0]


def test_images_with_channels_last_are_stacked_and_others_refused() -> None:
    assert stacked(MAZE, 2).shape == (84, 84, 9)
    with pytest.raises(ValueError, match=r"stack is 1; it must be 0 for images with channels first"):
        stacked(ATARI, 1)


# -------------------------------------------------------------------------------------------- agents

ROWS = [(domain, name) for domain in sorted(NAMES) for name in NAMES[domain]]


def _run(agent: Any, envs: SyncVectorEnv, updates: int) -> list[dict[str, float]]:
    steps = agent.train(envs, 10**9)
    return [next(steps) for _ in range(updates)]


@pytest.mark.parametrize(("domain", "name"), ROWS)
def test_every_agent_learns_from_images_and_resumes(domain: str, name: str) -> None:
    first, whole = _envs(domain), _envs(domain)
    agent = _agent(name, domain)
    _run(agent, first, 3)
    state, envs = copy.deepcopy(agent.state_dict()), copy.deepcopy(first)
    again = _agent(name, domain)
    again.load_state_dict(state)
    resumed = _run(again, envs, 2)
    uninterrupted = _run(_agent(name, domain), whole, 5)
    assert resumed == uninterrupted[3:]
    assert all(np.isfinite(list(metrics.values())).all() for metrics in uninterrupted)
    if name in ("eco", "sprl"):
        assert any("reachability_loss" in metrics for metrics in uninterrupted)
        assert uninterrupted[-1]["bonus"] != 0
    if name in ("icm", "gt-grid"):
        assert any(metrics["bonus"] > 0 for metrics in uninterrupted)


@pytest.mark.skipif(not torch.cuda.is_available(), reason="needs a GPU")
@pytest.mark.parametrize(("domain", "name"), ROWS)
def test_every_agent_learns_on_a_gpu(domain: str, name: str) -> None:
    metrics = _run(_agent(name, domain, "cuda"), _envs(domain), 4)
    assert all(np.isfinite(list(one.values())).all() for one in metrics)


def test_rewards_are_clipped_for_the_learner_alone() -> None:
    """The dot's 7 points are 1 to the Atari agents, and 7 to the others and to the env."""
    rewards = {}
    for domain in SPACES:
        agent = _agent("ppo", domain)
        _run(agent, _envs(domain), 1)
        collected = agent._collector.collect(agent.learner.policy())
        while not collected.rewards.any():
            collected = agent._collector.collect(agent.learner.policy())
        assert collected.rewards.max() == 7
        rewards[domain] = float(agent._training_rewards(collected, torch.zeros_like(collected.rewards)).max())
    assert rewards == {"atari": 1.0, "dmlab": 7.0}


def test_a_cell_of_a_maze_is_a_square_of_30_units() -> None:
    agent = _agent("gt-grid", "dmlab")
    envs = _envs("dmlab")
    _run(agent, envs, 1)
    cells = {number for visited in agent.bonus._visited for number in visited}
    assert agent.bonus._config.cube_size == 30
    places = {512 + (31 * x) // 30 + 1024 * (512 - 2) for x in range(6)}
    assert cells
    assert cells <= places


@pytest.mark.parametrize("agent", ["gt-grid", "gt-sprl", "count"])
def test_what_reads_the_true_state_is_refused_on_atari(agent: str) -> None:
    with pytest.raises(
        ValueError, match=f"agent is '{agent}'; it must be one with the preset 'table' of domain 'atari'"
    ):
        preset("atari", "table", agent)


def test_gt_grid_needs_positions() -> None:
    envs = SyncVectorEnv([lambda: _Blind(TINY["dmlab"])] * 2, autoreset_mode=AutoresetMode.SAME_STEP)
    envs.reset(seed=0)
    with pytest.raises(ValueError, match="info has no 'position'"):
        _run(_agent("gt-grid", "dmlab"), envs, 1)


class _Blind(Dot):
    def _look(self) -> tuple[Any, dict[str, Any]]:
        return super()._look()[0], {"is_success": False}


def test_a_trained_policy_acts_on_one_image() -> None:
    agent = _agent("ppo", "dmlab")
    _run(agent, _envs("dmlab"), 1)
    act = agent.policy(TINY["dmlab"], spaces.Discrete(3), 0)
    assert act(np.zeros((36, 40, 3), np.uint8)) in (0, 1, 2)
