"""The settings of each algorithm, in Stable-Baselines3's terms."""

from __future__ import annotations

from typing import Annotated, Literal, TypeAlias

from pydantic import Field, Strict

from mm_gym.scene import Part

Positive = Annotated[float, Field(gt=0)]
Count = Annotated[int, Field(ge=1)]
Batch = Annotated[int, Field(ge=2)]
Discount = Annotated[float, Field(gt=0, le=1)]
Fraction = Annotated[float, Field(ge=0, le=1)]
Hidden = Annotated[tuple[Count, ...], Strict(False)]

Algorithm: TypeAlias = Literal["ppo", "sac", "td3", "tqc", "crossq", "recurrent_ppo"]


class AlgorithmSettings(Part):
    """What all algorithms have."""

    learning_rate: Positive = 1e-3
    """learning rate of the optimiser"""
    batch_size: Batch = 256
    """samples of one gradient step"""
    discount: Discount = 0.97
    """discount factor gamma"""
    hidden: Hidden = (64, 64)
    """units of the hidden layers, of policy and value alike"""
    reward_scale: Positive = 0.05
    """factor on the reward, so that the value function is of order one"""


class PPOSettings(AlgorithmSettings):
    """Proximal policy optimisation (Schulman et al., 2017)."""

    learning_rate: Positive = 1e-3
    """learning rate at the start; it falls linearly to zero"""
    rollout: Count = 100
    """control steps per lane between updates"""
    batch_size: Batch = 3200
    """samples of one gradient step, at most those of a rollout"""
    epochs: Count = 8
    """passes over each rollout"""
    gae_lambda: Fraction = 0.95
    """trade of bias for variance in the advantage"""
    initial_log_std: float = -0.5
    """logarithm of the initial exploration noise"""


class RecurrentPPOSettings(PPOSettings):
    """PPO with a long short-term memory cell before the layers."""

    hidden: Hidden = (64,)
    """units of the layers after the cell, of policy and value alike"""
    units: Count = 32
    """units of the cell"""


class OffPolicySettings(AlgorithmSettings):
    """What the algorithms with a replay buffer have."""

    buffer_size: Count = 300_000
    """control steps of all lanes that are remembered"""
    learning_starts: Annotated[int, Field(ge=0)] = 10_000
    """control steps of all lanes before the first gradient step"""
    gradient_steps: Count = 4
    """gradient steps after each control step of all lanes"""
    reward_scale: Positive = 1.0
    """factor on the reward, so that the value function is of order one"""


class SACSettings(OffPolicySettings):
    """Soft actor-critic (Haarnoja et al., 2018), with a learned temperature."""

    tau: Fraction = 0.005
    """fraction by which the target network follows in a gradient step"""
    initial_entropy: Positive = 0.1
    """temperature at the start"""


class TD3Settings(OffPolicySettings):
    """Twin delayed deep deterministic policy gradient (Fujimoto et al., 2018)."""

    tau: Fraction = 0.005
    """fraction by which the target network follows in a gradient step"""
    noise: Positive = 0.1
    """standard deviation of the exploration noise"""


class TQCSettings(SACSettings):
    """Truncated quantile critics (Kuznetsov et al., 2020)."""

    dropped_quantiles: Annotated[int, Field(ge=0, lt=25)] = 2
    """quantiles that are dropped, of the 25 of each critic"""


class CrossQSettings(OffPolicySettings):
    """CrossQ (Bhatt et al., 2024): batch normalisation instead of target networks."""

    initial_entropy: Positive = 0.1
    """temperature at the start"""
