"""Acting: what a network answers to a few observations at a time, while its parameters do not change.

On a CPU a compiled form does it, whose weights are laid out once a rollout; it equals the plain form to rounding.
"""

from __future__ import annotations

from collections.abc import Callable

from torch import Tensor, nn

from sprl_baselines.kernels.convolutions import CReLUConvolutions
from sprl_baselines.kernels.packed_networks import PackedGridNetwork, PackedMLP
from sprl_baselines.learning.networks import ActorCritic

Acting = Callable[[Tensor], tuple[Tensor, Tensor | None]]
"""Takes observations `[N, ...]`; returns parameters of the action distributions `[N, A]`, and values `[N]`.

The values are None where they need a network of their own: then they are cheaper for a whole rollout at once.
"""


def acting(network: ActorCritic) -> Acting:
    """Return how the network acts by its present parameters."""
    on_cpu = next(network.parameters()).device.type == "cpu"
    has_compiled_form = network.has_crelu or not network.shared  # images have none: their convolutions take the time
    return compiled(network) if on_cpu and has_compiled_form else plain(network)


def plain(network: ActorCritic) -> Acting:
    """Return the network's own forward pass, without the values of a separate network."""

    def act(observations: Tensor) -> tuple[Tensor, Tensor | None]:
        features = network.policy_trunk(network.view(observations))
        values = network.value(features).squeeze(-1) if network.shared else None
        return network.head(features), values

    return act


def compiled(network: ActorCritic) -> Acting:
    """Return the same, compiled for the CPU."""
    layers = [module for module in network.policy_trunk if isinstance(module, nn.Linear)]
    if not network.shared:
        mlp = PackedMLP(layers, [network.head.linear])
        return lambda observations: (network.head.normalized(mlp(network.view(observations))), None)
    cells, convolutions = network.policy_trunk[0], network.policy_trunk[1]
    assert isinstance(convolutions, CReLUConvolutions)
    grid = PackedGridNetwork(convolutions, layers, [network.head.linear, network.value])

    def act(observations: Tensor) -> tuple[Tensor, Tensor | None]:
        units = grid(cells(network.view(observations)))
        return network.head.normalized(units[:, :-1]), units[:, -1]

    return act
