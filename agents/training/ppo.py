"""Proximal policy optimisation (PPO) of Stable-Baselines3, validated as it goes."""

from __future__ import annotations

import time
import warnings
from typing import TYPE_CHECKING

import gymnasium
import torch
from gymnasium.vector import AutoresetMode
from gymnasium.wrappers.vector import TransformReward
from stable_baselines3 import PPO
from stable_baselines3.common.callbacks import BaseCallback, ProgressBarCallback
from stable_baselines3.common.utils import LinearSchedule
from tqdm import TqdmExperimentalWarning

from agents.controllers.learned import Learned
from agents.evaluation.episodes import VALIDATION_SEED, evaluate
from agents.training.runs import save_whole
from mm_gym.files import write_csv
from mm_gym.sb3 import VectorEnvAdapter

if TYPE_CHECKING:
    from agents.training.config import TrainSettings
    from agents.training.runs import Run
    from mm_gym import Scene


def train(settings: TrainSettings, run: Run) -> None:
    """Train until steps or time are used up, and write the best model to the run's folder.

    A killed run continues from its last checkpoint.
    """
    run.open(settings)
    if run.finished:
        return
    torch.set_num_threads(settings.threads)
    scene = settings.load_scene()
    env = make_env(settings, scene)
    model = continue_or_begin(settings, run, env)
    if model.num_timesteps < settings.steps:
        learn(model, settings.steps - model.num_timesteps, Validation(settings, scene, run))
    env.close()
    (run.best if run.best.exists() else run.checkpoint).replace(run.model)


def learn(model: PPO, steps: int, validation: Validation) -> None:
    """Train for so many more steps, with a progress bar."""
    bar = ProgressBarCallback()
    fresh = model.num_timesteps == 0
    with warnings.catch_warnings():
        # Stable-Baselines3's progress bar is tqdm's rich one, which calls itself experimental.
        warnings.simplefilter("ignore", TqdmExperimentalWarning)
        try:
            model.learn(
                steps, callback=[validation, bar], reset_num_timesteps=fresh, tb_log_name="ppo"
            )
        finally:
            # Left open, the garbage collector closes it, perhaps in the thread that draws it.
            if hasattr(bar, "pbar"):
                bar.pbar.close()


def make_env(settings: TrainSettings, scene: Scene) -> VectorEnvAdapter:
    """Return the training lanes with scaled rewards."""
    lanes = gymnasium.make_vec(
        settings.task,
        num_envs=settings.lanes,
        vectorization_mode="vector_entry_point",
        scene=scene,
        autoreset_mode=AutoresetMode.SAME_STEP,
    )
    return VectorEnvAdapter(
        TransformReward(lanes, lambda reward: settings.ppo.reward_scale * reward)
    )


def continue_or_begin(settings: TrainSettings, run: Run, env: VectorEnvAdapter) -> PPO:
    """Return the model of the last checkpoint, or a new one."""
    if run.checkpoint.exists():
        return PPO.load(run.checkpoint, env=env, device="cpu")
    ppo = settings.ppo
    return PPO(
        "MlpPolicy",
        env,
        learning_rate=LinearSchedule(ppo.learning_rate, 0.0, 1.0),
        n_steps=ppo.rollout,
        batch_size=ppo.batch_size,
        n_epochs=ppo.epochs,
        gamma=ppo.discount,
        gae_lambda=ppo.gae_lambda,
        policy_kwargs={"net_arch": list(ppo.hidden), "log_std_init": ppo.initial_log_std},
        tensorboard_log=str(run.folder / "tensorboard"),
        seed=settings.seed,
        device="cpu",
    )


class Validation(BaseCallback):
    """Score the policy on the validation episodes and keep the best model.

    Also writes the checkpoint, and stops the training when the time is up.
    """

    def __init__(self, settings: TrainSettings, scene: Scene, run: Run) -> None:
        super().__init__()
        self.settings, self.scene, self.run = settings, scene, run
        self.every = -(-settings.steps // settings.evaluations)
        self.began = time.perf_counter()
        self.metrics = Metrics.read(run)

    def _on_training_start(self) -> None:
        self.next = self.num_timesteps + self.every

    def _on_rollout_start(self) -> None:
        if self.num_timesteps >= self.next:
            self.next += self.every
            self._validate()

    def _on_step(self) -> bool:
        return time.perf_counter() - self.began < self.settings.time_budget

    def _on_training_end(self) -> None:
        self._validate()

    def _validate(self) -> None:
        cost = evaluate(self.scene, Learned(self.model), seed=VALIDATION_SEED, episodes=100).cost
        self.logger.record("validation/cost", cost)
        if cost < self.metrics.best:
            save_whole(self.model, self.run.best)
        self.metrics.add(self.num_timesteps, time.perf_counter() - self.began, cost)
        self.metrics.write(self.run)
        save_whole(self.model, self.run.checkpoint)


class Metrics:
    """The validations so far, the rows of ``metrics.csv``."""

    HEADER = ("steps [-]", "time [s]", "cost [-]")

    def __init__(self, rows: list[tuple[float, float, float]]) -> None:
        self.rows = rows

    @classmethod
    def read(cls, run: Run) -> Metrics:
        """Read the rows that a killed run left, if any."""
        file = run.folder / "metrics.csv"
        lines = file.read_text(encoding="utf-8").splitlines()[1:] if file.exists() else []
        rows = [tuple(float(word) for word in line.split(",")) for line in lines]
        return cls([(row[0], row[1], row[2]) for row in rows])

    @property
    def best(self) -> float:
        """The least cost so far [-]."""
        return min((row[2] for row in self.rows), default=float("inf"))

    def add(self, steps: int, seconds: float, cost: float) -> None:
        """Append a row."""
        self.rows.append((float(steps), seconds, cost))

    def write(self, run: Run) -> None:
        """Write ``metrics.csv`` whole."""
        write_csv(run.folder / "metrics.csv", self.HEADER, list(zip(*self.rows, strict=True)))
