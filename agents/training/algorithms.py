"""Models of Stable-Baselines3 and sb3-contrib, made from settings, and policies taken from them."""

import io
from pathlib import Path
from typing import Any

import numpy as np
import torch
from stable_baselines3 import PPO
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.noise import NormalActionNoise
from stable_baselines3.common.torch_layers import FlattenExtractor
from stable_baselines3.common.utils import LinearSchedule
from stable_baselines3.common.vec_env import VecEnv
from torch import Tensor, nn

from agents.network.files import check_archive
from agents.policies import Policy, PolicyError, network
from agents.training import config
from agents.training.parts import NO_BASE
from mm_gym import SceneError
from mm_gym.arrays import Array
from mm_gym.extras import optional
from mm_gym.files import read_bytes

CLASSES = {
    "ppo": ("stable_baselines3", "PPO"),
    "sac": ("stable_baselines3", "SAC"),
    "td3": ("stable_baselines3", "TD3"),
    "tqc": ("sb3_contrib", "TQC"),
    "crossq": ("sb3_contrib", "CrossQ"),
    "recurrent_ppo": ("sb3_contrib", "RecurrentPPO"),
}


def algorithm_class(name: str) -> type[BaseAlgorithm]:
    """Return the class of an algorithm.

    Raise `DependencyNotInstalled` if it is one of sb3-contrib, and that is not installed.
    """
    module, attribute = CLASSES[name]
    remedy = f"algorithm {name!r} needs sb3-contrib: install the extra `contrib`"
    return getattr(optional(module, remedy), attribute)


ARGUMENTS = {
    "discount": "gamma",
    "rollout": "n_steps",
    "epochs": "n_epochs",
    "dropped_quantiles": "top_quantiles_to_drop_per_net",
}
"""Setting -> argument of the algorithm's class, where the names differ."""

OTHERS = {"hidden", "reward_scale", "initial_log_std", "units", "initial_entropy", "noise"}
"""Settings of an algorithm that are no arguments of its class."""


def make_model(settings: config.TrainSettings, log: Path, lanes: VecEnv) -> BaseAlgorithm:
    """Return an untrained model; around a base its mean action is zero.

    Parameters
    ----------
    log
        The folder for tensorboard.
    """
    chosen = settings.chosen
    policy: dict[str, Any] = {"net_arch": list(chosen.hidden)}
    given: dict[str, Any] = {
        ARGUMENTS.get(name, name): value for name, value in chosen if name not in OTHERS
    }
    if isinstance(chosen, config.PPOSettings):
        given["batch_size"] = min(chosen.batch_size, chosen.rollout * settings.lanes)
        given["learning_rate"] = LinearSchedule(chosen.learning_rate, 0.0, 1.0)
        policy["log_std_init"] = chosen.initial_log_std
    else:
        given["train_freq"] = 1
    if isinstance(chosen, config.RecurrentPPOSettings):
        policy["lstm_hidden_size"] = chosen.units
    if isinstance(chosen, (config.SACSettings, config.CrossQSettings)):
        given["ent_coef"] = f"auto_{chosen.initial_entropy}"
    if isinstance(chosen, config.TD3Settings):
        still = np.zeros(lanes.action_space.shape)
        given["action_noise"] = NormalActionNoise(still, still + chosen.noise)
    model = algorithm_class(settings.algorithm)(
        "MlpLstmPolicy" if isinstance(chosen, config.RecurrentPPOSettings) else "MlpPolicy",
        lanes,
        tensorboard_log=str(log),
        seed=settings.seed,
        device="cpu",
        policy_kwargs=policy,
        **given,  # pyright: ignore[reportArgumentType]
    )
    if settings.base not in {None, NO_BASE}:
        _begin_at_zero(model)
    return model


def _begin_at_zero(model: BaseAlgorithm) -> None:
    """Set the layer that makes the mean action to zero, in the target network too."""
    (*_, last), _ = _modules(model)
    layers: list[Any] = [last]
    if hasattr(model.policy, "actor_target"):
        layers.append(model.policy.actor_target.mu[-2])  # a tanh is behind it
    with torch.no_grad():
        for layer in layers:
            layer.weight.zero_()
            layer.bias.zero_()


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
    plain = isinstance(extractor, FlattenExtractor) and len(set(activations)) <= 1
    if not (plain and len(activations) == len(layers) - 1 and set(activations) <= set(ACTIVATIONS)):
        msg = "policy: only dense layers with tanh or ReLU between them can be scored"
        raise PolicyError(msg)
    cell = _cell(model)
    observed, statistics = model.observation_space.shape[0], model.get_vec_normalize_env()
    zero, unit = np.zeros(observed), np.ones(observed)
    if statistics is not None and statistics.norm_obs:
        zero, spread = statistics.obs_rms.mean, statistics.obs_rms.var
        unit = np.sqrt(spread + statistics.epsilon)
    if cell:
        cell[0], cell[2] = cell[0] / unit, cell[2] - cell[0] @ (zero / unit)
    else:
        weight, bias = layers[0]
        layers[0] = weight / unit, bias - weight @ (zero / unit)
    return network(
        [weight for weight, _ in layers],
        [bias for _, bias in layers],
        ACTIVATIONS[activations[0]] if activations else "tanh",
        model.action_space.low,
        model.action_space.high,
        squashed=bool(model.policy.squash_output),
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
    if not hasattr(model.policy, "lstm_actor"):
        return []
    lstm = model.policy.lstm_actor
    return [
        _array(lstm.weight_ih_l0),
        _array(lstm.weight_hh_l0),
        _array(lstm.bias_ih_l0) + _array(lstm.bias_hh_l0),
    ]


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
