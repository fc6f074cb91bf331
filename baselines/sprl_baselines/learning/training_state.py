"""The training state of a network: parameters, the optimizer's moments and a generator's state."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

import torch
from torch import Tensor, nn
from torch.optim import Optimizer

ADAM: Final = {"exp_avg", "exp_avg_sq", "step"}
"""What Adam keeps of each parameter."""


def saved(network: nn.Module, optimizer: Optimizer, generator: torch.Generator) -> dict[str, Any]:
    """Return copies of the states of all three."""
    moments = optimizer.state_dict()["state"]
    return {
        "network": {name: value.clone() for name, value in network.state_dict().items()},
        "optimizer": {
            str(index): {name: value.clone() for name, value in moment.items()} for index, moment in moments.items()
        },
        "generator": generator.get_state(),
    }


def load_weights(network: nn.Module, weights: Mapping[str, Tensor]) -> None:
    """Give a network the weights of a trained one.

    Raises:
        ValueError: They are of another network, or lack the moments that observations are normalised by.
    """
    own = network.state_dict().keys()
    if missing := sorted(own - weights.keys()):
        raise ValueError(f"The weights lack {missing[0]}, which the agent's hyperparameters ask for.")
    if unknown := sorted(weights.keys() - own):
        raise ValueError(f"The weights hold {unknown[0]}, for which the agent's hyperparameters have no use.")
    network.load_state_dict(weights)


def restore(network: nn.Module, optimizer: Optimizer, generator: torch.Generator, state: Mapping[str, Any]) -> None:
    """Restore such a state of all three; the optimizer keeps its own settings.

    Raises:
        ValueError: It lacks a part of the network or of the optimizer, or is of another network.
    """
    load_weights(network, state["network"])
    groups = optimizer.state_dict()["param_groups"]
    _check_moments(state["optimizer"], sum(len(group["params"]) for group in groups))
    moments = {
        int(index): {name: value.clone() for name, value in moment.items()}  # Adam would change the state's own tensors
        for index, moment in state["optimizer"].items()
    }
    optimizer.load_state_dict({"state": moments, "param_groups": groups})
    generator.set_state(state["generator"].cpu())


def _check_moments(moments: Mapping[str, Any], count: int) -> None:
    """Refuse a state of Adam that lacks a part; torch would begin anew with that parameter.

    Raises:
        ValueError: There are moments, but not all of all parameters.
    """
    for index in map(str, range(count if moments else 0)):
        if missing := sorted(ADAM - moments.get(index, {}).keys()):
            raise ValueError(f"The optimizer's state of parameter {index} lacks {missing[0]}.")
