"""Cost of the environment in training: PPO with the native `VecEnv` and with `DummyVecEnv`."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING

import torch
from stable_baselines3 import PPO
from stable_baselines3.common.vec_env import DummyVecEnv

from benchmarks.report import table
from mm_gym import MovingMassEnv
from mm_gym.sb3 import make_vec_env

if TYPE_CHECKING:
    from stable_baselines3.common.vec_env import VecEnv

TASK = "mm_gym/PreStretch-v0"
LANES = 64
ROLLOUT = 200
ROUNDS = 5


class Stopwatch:
    """A sum of the time [s] that a `VecEnv` spends in its steps."""

    def __init__(self, env: VecEnv) -> None:
        self.env, self.seconds = env, 0.0
        self.step = env.step
        env.step = self._timed

    def _timed(self, actions: object) -> object:
        began = time.perf_counter()
        result = self.step(actions)
        self.seconds += time.perf_counter() - began
        return result


def learning() -> str:
    """Return the section on training with 64 lanes, in turns, with SB3's default networks."""
    torch.set_num_threads(1)
    envs = {
        "native VecEnv": make_vec_env(TASK, LANES),
        "DummyVecEnv": DummyVecEnv([lambda: MovingMassEnv(TASK)] * LANES),
    }
    watches = {name: Stopwatch(env) for name, env in envs.items()}
    models = {
        name: PPO("MlpPolicy", env, n_steps=ROLLOUT, batch_size=1600, seed=0, device="cpu")
        for name, env in envs.items()
    }
    totals = dict.fromkeys(envs, 0.0)
    for model in models.values():
        model.learn(LANES * ROLLOUT)
    for watch in watches.values():
        watch.seconds = 0.0
    for _ in range(ROUNDS):
        for name, model in models.items():
            began = time.perf_counter()
            model.learn(LANES * ROLLOUT, reset_num_timesteps=False)
            totals[name] += time.perf_counter() - began
    frames = ROUNDS * LANES * ROLLOUT
    rows = [
        (
            name,
            f"{frames / totals[name]:,.0f}",
            f"{watches[name].seconds / totals[name] * 100:.1f} %",
            f"{totals['DummyVecEnv'] / totals[name]:.2f}",
        )
        for name in envs
    ]
    header = (
        f"PPO, {LANES} lanes of PreStretch",
        "frames/s",
        "time in the environment",
        "times as fast as DummyVecEnv",
    )
    return f"## Training\n\n{table(header, rows)}\n"
