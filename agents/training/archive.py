"""Stable-Baselines3's models and archives: policies taken from them."""

import io
from pathlib import Path
from typing import Any

import numpy as np
from stable_baselines3 import PPO
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.torch_layers import FlattenExtractor
from torch import Tensor, nn

from agents.network.files import check_archive
from agents.policies import Policy, PolicyError, network
from mm_gym import SceneError
from mm_gym.arrays import Array
from mm_gym.files import read_bytes

LARGEST = 2**30
"""Of an archive [bytes], and of what it unpacks to: with its optimiser it has three times the
numbers of a policy."""

ACTIVATIONS = {nn.Tanh: "tanh", nn.ReLU: "relu"}


def policy_of(model: BaseAlgorithm) -> Policy:
    """Return the mean action of a model as a policy, which takes observations as they are.

    The observations' normalisation, and that of the layers of CrossQ, are linear and become part of
    the weights. Raise `PolicyError` if the model's policy is more than dense layers of one
    activation, tanh or ReLU, after an LSTM cell or none.
    """
    modules, extractor = _modules(model)
    layers, activations = _layers(modules)
    squashed = bool(model.policy.squash_output)
    plain = isinstance(extractor, FlattenExtractor) and len(set(activations)) <= 1
    if not (plain and len(activations) == len(layers) - 1 and set(activations) <= set(ACTIVATIONS)):
        msg = "policy: only dense layers with tanh or ReLU between them can be scored"
        raise PolicyError(msg)
    first, *others = layers
    cell = _cell(model)
    zero, unit = _normalisation(model)
    if cell:
        cell[0], cell[2] = cell[0] / unit, cell[2] - cell[0] @ (zero / unit)
    else:
        first = first[0] / unit, first[1] - first[0] @ (zero / unit)
    layers = [first, *others]
    return network(
        [weight for weight, _ in layers],
        [bias for _, bias in layers],
        ACTIVATIONS[activations[0]] if activations else "tanh",
        model.action_space.low,
        model.action_space.high,
        squashed=squashed,
        cell=cell,
    )


def _modules(model: BaseAlgorithm) -> tuple[list[nn.Module], nn.Module]:
    """Return what makes the mean action, in order but for a last tanh, and what is before it."""
    policy = model.policy
    if hasattr(policy, "action_net"):
        return [*policy.mlp_extractor.policy_net, policy.action_net], policy.features_extractor
    actor = policy.actor
    if hasattr(actor, "latent_pi"):
        return [*actor.latent_pi, actor.mu], actor.features_extractor
    *modules, _ = actor.mu
    return modules, actor.features_extractor


def _layers(modules: list[nn.Module]) -> tuple[list[tuple[Array, Array]], list[type[nn.Module]]]:
    """Return the weights and biases of the dense layers, and what is between them."""
    layers: list[tuple[Array, Array]] = []
    activations: list[type[nn.Module]] = []
    unit, zero = np.ones(1), np.zeros(1)  # of the normalisation before a layer
    for module in modules:
        if isinstance(module, nn.Linear):
            weight, bias = _array(module.weight), _array(module.bias)
            layers.append((weight * unit, bias + (weight * zero).sum(axis=1)))
            unit, zero = np.ones(1), np.zeros(1)
        elif hasattr(module, "ra_mean"):  # sb3-contrib's batch renormalisation
            unit = _array(module.scale) / np.sqrt(_array(module.ra_var) + module.eps)
            zero = _array(module.bias) - unit * _array(module.ra_mean)
        else:
            activations.append(type(module))
    return layers, activations


def _cell(model: BaseAlgorithm) -> list[Array]:
    """Return the weights of the LSTM cell, or none."""
    if not hasattr(model.policy, "lstm_actor"):
        return []
    lstm = model.policy.lstm_actor
    return [
        _array(lstm.weight_ih_l0),
        _array(lstm.weight_hh_l0),
        _array(lstm.bias_ih_l0) + _array(lstm.bias_hh_l0),
    ]


def _normalisation(model: BaseAlgorithm) -> tuple[Array, Array]:
    """Return the mean and the spread of the observations, if they are normalised."""
    statistics = model.get_vec_normalize_env()
    if statistics is None or not statistics.norm_obs:
        observed = model.observation_space.shape[0]
        return np.zeros(observed), np.ones(observed)
    return statistics.obs_rms.mean, np.sqrt(statistics.obs_rms.var + statistics.epsilon)


def open_trusted(path: Path) -> Policy:
    """Return the policy of an archive that `PPO.save` wrote.

    **Opening an archive can run code that it carries.** Raise `PolicyError` if the file is missing,
    too large, damaged, or no such archive.
    """
    try:
        content = io.BytesIO(read_bytes(path, most=LARGEST))
    except SceneError as error:
        raise PolicyError(str(error)) from None
    try:
        check_archive(content.getvalue(), most=LARGEST)
        return policy_of(PPO.load(content, device="cpu"))
    except Exception as error:  # what is unpickled raises what it likes
        msg = f"{path}: not an archive of Stable-Baselines3's PPO: {error}"
        raise PolicyError(msg) from error


def _array(tensor: Tensor | Any) -> Array:  # noqa: ANN401 - modules have undeclared tensors
    return tensor.detach().cpu().numpy().astype(np.float64)
