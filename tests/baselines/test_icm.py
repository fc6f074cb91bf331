"""ICM: bonus, losses and gradients against a plain loop in NumPy, and what training does to them."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
import torch
from gymnasium import Space, spaces
from torch import Tensor, nn
from torch.nn import functional

from sprl_baselines.bonus import Setting
from sprl_baselines.icm import ICM, ICMConfig
from sprl_baselines.kernels.strided_convolution import StridedConvolution
from sprl_baselines.learning.rollout import Rollout

CPU = torch.device("cpu")
STEPS, NUM_ENVS = 20, 3
GRID = spaces.Box(0, 255, (7, 5, 3), np.uint8)
FLAT = spaces.Box(-np.inf, np.inf, (6,), np.float32)
DISCRETE = spaces.Discrete(4)
CONTINUOUS = spaces.Box(-1, 1, (2,), np.float32)
Array = npt.NDArray[np.float64]

every_kind = pytest.mark.parametrize(
    ("observations", "actions"),
    [(GRID, DISCRETE), (FLAT, DISCRETE), (FLAT, CONTINUOUS)],
    ids=["grid-discrete", "flat-discrete", "flat-continuous"],
)


def icm(observations: Space[Any], actions: Space[Any], seed: int = 0, **hyperparameters: Any) -> ICM:
    return ICM(Setting(observations, actions, NUM_ENVS, seed, CPU), ICMConfig(**hyperparameters))


def drawn_rollout(observations: Space[Any], actions: Space[Any], seed: int = 0) -> Rollout:
    """Return steps of no env, drawn by chance; some repeat an observation, some end an episode."""
    generator = torch.Generator().manual_seed(seed)
    shape = (STEPS, NUM_ENVS)

    def observed(*rows: int) -> Tensor:
        assert observations.shape is not None
        if observations is GRID:  # few distinct ones
            pool = torch.randint(0, 4, (40, *observations.shape), generator=generator, dtype=torch.uint8)
            return pool[torch.randint(0, 40, rows, generator=generator)]
        return 2 * torch.randn(*rows, *observations.shape, generator=generator)

    acted = (
        torch.randint(0, 4, shape, generator=generator)
        if actions is DISCRETE
        else 2 * torch.randn(*shape, 2, generator=generator)  # beyond the box, as a policy draws them
    )
    ended = torch.rand(shape, generator=generator) < 0.2
    zeros = torch.zeros(shape)
    return Rollout(
        observations=observed(*shape),
        actions=acted,
        rewards=zeros,
        terminated=ended,
        truncated=torch.zeros_like(ended),
        values=zeros,
        log_probs=zeros,
        last_observations=observed(NUM_ENVS),
        final_observations=observed(int(ended.sum())),
        positions=torch.empty(*shape, 0, dtype=torch.int64),
        next_positions=torch.empty(*shape, 0, dtype=torch.int64),
    )


# ------------------------------------------------------------------------------- the plain reference


def parameters_of(network: nn.Module, kind: type[nn.Module]) -> list[tuple[Array, Array]]:
    """Return weights and biases of the network's layers of one kind, in order."""
    layers: list[Any] = [module for module in network.modules() if isinstance(module, kind)]
    return [(layer.weight.detach().double().numpy(), layer.bias.detach().double().numpy()) for layer in layers]


def phi(network: Any, observation: npt.NDArray[Any]) -> Array:
    if observation.ndim == 3:
        return convolved(network.phi, observation / np.array([10.0, 5.0, 3.0]))
    features = observation.astype(np.float64)
    layers = parameters_of(network.phi, nn.Linear)
    assert [weight.shape for weight, _ in layers] == [(6, 6)] * 4
    for weight, bias in layers:
        features = np.maximum(weight @ features + bias, 0)
    return features


def convolved(network: nn.Module, image: Array) -> Array:
    """Four convolutions 3x3 with stride 2 and a border of zeros, each followed by an ELU; cells [H, W, C]."""
    layers = parameters_of(network, StridedConvolution)
    assert [weight.shape for weight, _ in layers] == [(32, inputs, 3, 3) for inputs in (3, 32, 32, 32)]
    for weight, bias in layers:
        padded = np.pad(image, ((1, 1), (1, 1), (0, 0)))
        rows, columns = (image.shape[0] + 1) // 2, (image.shape[1] + 1) // 2
        out = np.empty((rows, columns, 32))
        for y in range(rows):
            for x in range(columns):
                window = padded[2 * y : 2 * y + 3, 2 * x : 2 * x + 3]  # [3, 3, C]
                out[y, x] = np.einsum("oiyx,yxi->o", weight, window) + bias
        image = np.where(out > 0, out, np.expm1(out))
    return image.reshape(-1)


@pytest.mark.parametrize("sides", [(1, 1), (2, 3), (7, 7), (8, 5), (11, 11)])
@pytest.mark.parametrize("count", [0, 6])
def test_a_strided_convolution_is_pytorchs_in_outputs_and_gradients(sides: tuple[int, int], count: int) -> None:
    generator = torch.Generator().manual_seed(0)
    layer = StridedConvolution(4, sides, 1.0, generator)
    with torch.no_grad():
        layer.bias.normal_(generator=generator)
    images = torch.randn(count, 4, *sides, generator=generator, requires_grad=True)
    plain = functional.conv2d(images, layer.weight, layer.bias, stride=2, padding=1)
    ours, wanted = layer(images), [images, layer.weight, layer.bias]
    torch.testing.assert_close(ours, plain, rtol=1e-4, atol=1e-4)
    direction = torch.randn(plain.shape, generator=generator)
    gradients = (torch.autograd.grad((out * direction).sum(), wanted) for out in (ours, plain))
    for found, expected in zip(*gradients, strict=True):
        torch.testing.assert_close(found, expected, rtol=1e-4, atol=1e-4)


def test_a_strided_convolution_refuses_images_of_other_sides() -> None:
    layer = StridedConvolution(3, (7, 7), 1.0, torch.Generator().manual_seed(0))
    with pytest.raises(ValueError, match=r"Sides of images is \(7, 9\); it must be \(7, 7\)"):
        layer(torch.zeros(1, 3, 7, 9))


def hidden_layer(network: nn.Module, inputs: Array) -> Array:
    (first, first_bias), (second, second_bias) = parameters_of(network, nn.Linear)
    assert len(first) == 256
    return second @ np.maximum(first @ inputs + first_bias, 0) + second_bias


def plain(bonus: ICM, rollout: Rollout) -> dict[str, Any]:
    """Return errors [T, N] and the means that `update` reports, one step at a time."""
    following, finals = rollout.next_observations.numpy(), iter(rollout.final_observations.numpy())
    errors, inverse_losses, right, features = np.empty((STEPS, NUM_ENVS)), [], [], []
    for step in range(STEPS):
        for env in range(NUM_ENVS):
            after = following[step, env]
            if rollout.ended[step, env]:
                assert np.array_equal(after, next(finals))
            before, after = (phi(bonus.network, row) for row in (rollout.observations[step, env].numpy(), after))
            action = rollout.actions[step, env].double().numpy()
            numbers = np.eye(4)[int(action)] if action.ndim == 0 else action
            predicted = hidden_layer(bonus.network.forward_model, np.concatenate((before, numbers)))
            errors[step, env] = 0.5 * np.mean((predicted - after) ** 2) * 288
            answer = hidden_layer(bonus.network.inverse_model, np.concatenate((before, after)))
            if action.ndim == 0:
                inverse_losses.append(np.log(np.exp(answer).sum()) - answer[int(action)])
                right.append(answer.argmax() == action)
            else:
                inverse_losses.append(np.mean((answer - action) ** 2))
            features.append(after)
    means = {"forward_loss": errors.mean(), "inverse_loss": np.mean(inverse_losses)}
    if right:
        means["inverse_accuracy"] = np.mean(right)
    return {"errors": errors, "means": {**means, "phi_variance": np.var(features, axis=0).mean()}}


# ---------------------------------------------------------------------------------- bonus and losses


@every_kind
def test_the_bonus_is_the_clipped_error_of_the_forward_model(observations: Space[Any], actions: Space[Any]) -> None:
    rollout = drawn_rollout(observations, actions)
    bonus = icm(observations, actions)
    seen = []
    for _ in range(3):
        errors = plain(bonus, rollout)["errors"]
        np.testing.assert_allclose(bonus.reward(rollout).numpy(), 0.1 * np.clip(errors, -1, 1), rtol=1e-4)
        seen.extend(errors.flatten())
        bonus.update(rollout)
    assert min(seen) < 1 < max(seen)


@every_kind
def test_the_metrics_are_the_losses_of_a_plain_loop(observations: Space[Any], actions: Space[Any]) -> None:
    """One gradient step over everything reports what was so before it."""
    rollout = drawn_rollout(observations, actions)
    bonus = icm(observations, actions, icm_epochs=1, icm_minibatches=1)
    for _ in range(3):
        expected = plain(bonus, rollout)["means"]
        metrics = bonus.update(rollout)
        assert set(metrics) == set(expected)
        for name, value in expected.items():
            assert metrics[name] == pytest.approx(value, rel=1e-4), name


def test_without_a_weight_there_is_no_bonus() -> None:
    rollout = drawn_rollout(FLAT, DISCRETE)
    assert not icm(FLAT, DISCRETE, bonus_weight=0).reward(rollout).any()


def test_an_end_is_judged_by_its_true_successor() -> None:
    """Another final observation moves the ending step's bonus alone; a start is nobody's successor."""
    rollout = drawn_rollout(FLAT, DISCRETE)
    bonus = icm(FLAT, DISCRETE, bonus_weight=1e-3)
    weighed = {"final_observations": rollout.final_observations / 100, "terminated": rollout.terminated}
    changed = bonus.reward(replace(rollout, **weighed)) != bonus.reward(rollout)
    assert changed.any()
    assert not changed[~rollout.ended].any()


# ----------------------------------------------------------------------------------------- gradients


def gradients(rollout: Rollout, **hyperparameters: Any) -> dict[str, Tensor]:
    """Return what the first gradient step over everything was made with."""
    bonus = icm(GRID, DISCRETE, icm_epochs=1, icm_minibatches=1, **hyperparameters)
    bonus.update(rollout)
    return {name: value.grad for name, value in bonus.network.named_parameters() if value.grad is not None}


def test_the_loss_weighs_forward_and_inverse_and_its_gradient_is_cut() -> None:
    """phi learns from both losses, each model from its own."""
    rollout = drawn_rollout(GRID, DISCRETE)
    free = {"icm_max_grad_norm": 1e9}
    forward = gradients(rollout, forward_share=1, icm_loss_weight=1, **free)
    inverse = gradients(rollout, forward_share=0, icm_loss_weight=1, **free)
    both = gradients(rollout, forward_share=0.8, icm_loss_weight=0.3, **free)
    cut = gradients(rollout, forward_share=0.8, icm_loss_weight=0.3)
    norm = torch.stack([gradient.square().sum() for gradient in both.values()]).sum().sqrt()
    assert norm > 0.5
    for name, gradient in both.items():
        torch.testing.assert_close(gradient, 0.3 * (0.8 * forward[name] + 0.2 * inverse[name]), rtol=1e-3, atol=1e-5)
        torch.testing.assert_close(cut[name], gradient * 0.5 / norm, rtol=1e-3, atol=1e-6)
        assert bool(forward[name].any()) == (not name.startswith("inverse_model"))
        assert bool(inverse[name].any()) == (not name.startswith("forward_model"))


@every_kind
def test_phi_learns_from_all_that_it_enters(observations: Space[Any], actions: Space[Any]) -> None:
    """Also as the successor that the forward model aims at: the slope of the plain loop's loss along one parameter."""
    rollout = drawn_rollout(observations, actions)
    free: dict[str, Any] = {"icm_epochs": 1, "icm_minibatches": 1, "icm_max_grad_norm": 1e9, "icm_loss_weight": 2.0}
    used, fresh = (icm(observations, actions, forward_share=0.75, **free) for _ in range(2))
    used.update(rollout)
    slopes: Any = list(used.network.phi.parameters())[1].grad
    parameter, place, losses = list(fresh.network.phi.parameters())[1], slopes.abs().argmax(), []
    for step in (-1e-3, 1e-3):
        with torch.no_grad():
            parameter[place] = step  # 0 at first
        means = plain(fresh, rollout)["means"]
        losses.append(2 * (0.75 * means["forward_loss"] + 0.25 * means["inverse_loss"]))
    assert slopes[place] == pytest.approx((losses[1] - losses[0]) / 2e-3, rel=0.02)


@pytest.mark.parametrize(("share", "still"), [(1.0, "inverse_model"), (0.0, "forward_model")])
def test_a_share_of_1_switches_the_inverse_model_off_and_0_the_forward_model(share: float, still: str) -> None:
    bonus = icm(FLAT, CONTINUOUS, forward_share=share)
    before = {name: value.detach().clone() for name, value in bonus.network.named_parameters()}
    bonus.update(drawn_rollout(FLAT, CONTINUOUS))
    for name, value in bonus.network.named_parameters():
        assert torch.equal(value, before[name]) == name.startswith(still), name


def test_an_update_takes_as_many_steps_as_asked_for_and_another_order_each_time() -> None:
    rollout = drawn_rollout(GRID, DISCRETE)
    bonus = icm(GRID, DISCRETE, icm_epochs=3, icm_minibatches=7)
    generator = bonus.state_dict()["generator"]
    bonus.update(rollout)
    state = bonus.state_dict()
    assert {float(moments["step"]) for moments in state["optimizer"].values()} == {21.0}
    assert not torch.equal(state["generator"], generator)


# ------------------------------------------------------------------------------------------ learning


@every_kind
def test_training_lowers_the_forward_loss(observations: Space[Any], actions: Space[Any]) -> None:
    rollout = drawn_rollout(observations, actions)
    bonus = icm(observations, actions)
    first, *_, last = [bonus.update(rollout)["forward_loss"] for _ in range(10)]
    assert last < 0.2 * first


def moved(actions: Space[Any], seed: int) -> Rollout:
    """Return steps that each add what the action says to the observation."""
    rollout = drawn_rollout(FLAT, actions, seed)
    acted = rollout.actions if actions is CONTINUOUS else torch.eye(4)[rollout.actions]
    shift = torch.nn.functional.pad(acted, (0, 6 - acted.shape[-1]))
    following = rollout.observations + shift
    return replace(
        rollout,
        terminated=torch.ones_like(rollout.terminated),
        final_observations=following.flatten(0, 1),
    )


@pytest.mark.parametrize("actions", [DISCRETE, CONTINUOUS], ids=["discrete", "continuous"])
def test_the_inverse_model_learns_to_tell_actions(actions: Space[Any]) -> None:
    bonus = icm(FLAT, actions, forward_share=0.0, icm_loss_weight=1.0, icm_epochs=1, icm_learning_rate=0.01)
    reports = [bonus.update(moved(actions, seed)) for seed in range(100)]
    assert reports[-1]["inverse_loss"] < 0.5 * reports[0]["inverse_loss"]
    if actions is DISCRETE:
        assert reports[-1]["inverse_accuracy"] > 0.6  # by chance 0.25


# -------------------------------------------------------------------------------------- wrong values


def test_its_optimizer_is_as_its_settings_say() -> None:
    made = icm(FLAT, DISCRETE, icm_learning_rate=0.02, icm_adam_epsilon=0.5)
    [group] = made._optimizer.param_groups
    assert (group["lr"], group["eps"]) == (0.02, 0.5)


def test_more_minibatches_than_transitions_are_refused() -> None:
    with pytest.raises(ValueError, match=r"icm_minibatches is 61; it must be at most num_envs \* rollout_length, 60"):
        ICMConfig(icm_minibatches=61).check_rollout(60)


@pytest.mark.parametrize(
    ("observations", "actions", "complaint"),
    [
        (spaces.Discrete(5), DISCRETE, "observation_space is Discrete.*; it must be"),
        (FLAT, spaces.MultiDiscrete([2, 2]), "action_space is MultiDiscrete.*; it must be"),
        (FLAT, spaces.Discrete(3, start=1), "action_space is Discrete.*; it must be"),
    ],
)
def test_other_spaces_are_refused(observations: Space[Any], actions: Space[Any], complaint: str) -> None:
    with pytest.raises(ValueError, match=complaint):
        icm(observations, actions)
