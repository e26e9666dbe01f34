"""Stable-Baselines3's models and archives: policies taken from them."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from stable_baselines3 import PPO
from stable_baselines3.common.torch_layers import FlattenExtractor
from torch import nn

from agents.policies import Policy, PolicyError

if TYPE_CHECKING:
    from pathlib import Path

    from numpy.typing import NDArray
    from torch import Tensor

ACTIVATIONS = {nn.Tanh: "tanh", nn.ReLU: "relu"}


def policy_of(model: PPO) -> Policy:
    """Return the mean action of a model as a policy.

    Raises
    ------
    PolicyError
        If the model's policy is more than dense layers of one activation, tanh or ReLU.
    """
    policy = model.policy
    modules = [*policy.mlp_extractor.policy_net, policy.action_net]
    dense, between = modules[::2], {type(module) for module in modules[1::2]}
    plain = isinstance(policy.features_extractor, FlattenExtractor) and not policy.squash_output
    if not (
        plain
        and all(isinstance(module, nn.Linear) for module in dense)
        and len(between) <= 1
        and between <= set(ACTIVATIONS)
    ):
        msg = "policy: only dense layers with tanh or ReLU between them can be scored"
        raise PolicyError(msg)
    return Policy(
        weights=tuple(_array(module.weight) for module in dense),
        biases=tuple(_array(module.bias) for module in dense),
        activation=ACTIVATIONS[between.pop()] if between else "tanh",
        low=np.asarray(model.action_space.low, np.float32),
        high=np.asarray(model.action_space.high, np.float32),
    )


def open_trusted(path: Path) -> Policy:
    """Return the policy of an archive that `PPO.save` wrote.

    **Opening an archive can run code that it carries.**
    """
    try:
        return policy_of(PPO.load(path, device="cpu"))
    except (ValueError, KeyError, OSError, AttributeError, TypeError, AssertionError) as error:
        msg = f"{path}: not an archive of Stable-Baselines3's PPO: {error}"
        raise PolicyError(msg) from error


def _array(tensor: Tensor) -> NDArray[np.float32]:
    return tensor.detach().cpu().numpy().copy()
