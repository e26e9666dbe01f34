"""Untrained models of Stable-Baselines3 and sb3-contrib, made from a run's settings."""

from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import torch
from gymnasium.error import DependencyNotInstalled
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.noise import NormalActionNoise
from stable_baselines3.common.utils import LinearSchedule
from stable_baselines3.common.vec_env import VecEnv

from agents.training import algorithm_settings as kinds
from agents.training.algorithm_settings import AlgorithmSettings
from agents.training.config import TrainSettings
from agents.training.parts import NO_BASE

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
    try:
        return getattr(import_module(module), attribute)
    except ImportError as error:
        msg = f"algorithm {name!r} needs sb3-contrib: install the extra `contrib`"
        raise DependencyNotInstalled(msg) from error


def make_model(settings: TrainSettings, log: Path, lanes: VecEnv) -> BaseAlgorithm:
    """Return an untrained model; around a base its mean action is zero.

    Parameters
    ----------
    log
        The folder for tensorboard.
    """
    chosen = settings.chosen
    policy: dict[str, Any] = {"net_arch": list(chosen.hidden)}
    batch = chosen.batch_size
    if isinstance(chosen, kinds.PPOSettings):
        batch = min(batch, chosen.rollout * settings.lanes)
    special = _on_policy if isinstance(chosen, kinds.PPOSettings) else _off_policy
    model = algorithm_class(settings.algorithm)(
        "MlpLstmPolicy" if isinstance(chosen, kinds.RecurrentPPOSettings) else "MlpPolicy",
        lanes,
        batch_size=batch,
        gamma=chosen.discount,
        tensorboard_log=str(log),
        seed=settings.seed,
        device="cpu",
        **special(chosen, policy, lanes.action_space.shape[0]),  # pyright: ignore[reportArgumentType, reportOptionalSubscript]
        policy_kwargs=policy,
    )
    if settings.base not in {None, NO_BASE}:
        _begin_at_zero(model)
    return model


def _on_policy(chosen: kinds.PPOSettings, policy: dict[str, Any], _: int) -> dict[str, Any]:
    policy["log_std_init"] = chosen.initial_log_std
    if isinstance(chosen, kinds.RecurrentPPOSettings):
        policy["lstm_hidden_size"] = chosen.units
    return {
        "learning_rate": LinearSchedule(chosen.learning_rate, 0.0, 1.0),
        "n_steps": chosen.rollout,
        "n_epochs": chosen.epochs,
        "gae_lambda": chosen.gae_lambda,
    }


def _off_policy(chosen: AlgorithmSettings, _: dict[str, Any], actions: int) -> dict[str, Any]:
    assert isinstance(chosen, kinds.OffPolicySettings)  # noqa: S101 - there are two families
    arguments: dict[str, Any] = {
        "learning_rate": chosen.learning_rate,
        "buffer_size": chosen.buffer_size,
        "learning_starts": chosen.learning_starts,
        "gradient_steps": chosen.gradient_steps,
        "train_freq": 1,
    }
    if isinstance(chosen, (kinds.SACSettings, kinds.TD3Settings)):
        arguments["tau"] = chosen.tau
    if isinstance(chosen, (kinds.SACSettings, kinds.CrossQSettings)):
        arguments["ent_coef"] = f"auto_{chosen.initial_entropy}"
    if isinstance(chosen, kinds.TD3Settings):
        arguments["action_noise"] = NormalActionNoise(
            np.zeros(actions), np.full(actions, chosen.noise)
        )
    if isinstance(chosen, kinds.TQCSettings):
        arguments["top_quantiles_to_drop_per_net"] = chosen.dropped_quantiles
    return arguments


def _begin_at_zero(model: BaseAlgorithm) -> None:
    """Set the layer that makes the mean action to zero, in the target network too."""
    policy = model.policy
    if hasattr(policy, "action_net"):
        layers = [policy.action_net]
    elif hasattr(policy.actor.mu, "weight"):
        layers = [policy.actor.mu]
    else:  # a tanh is last
        layers = [policy.actor.mu[-2], policy.actor_target.mu[-2]]
    with torch.no_grad():
        for layer in layers:
            layer.weight.zero_()
            layer.bias.zero_()
