"""Proximal policy optimisation (PPO) of Stable-Baselines3, validated as it goes."""

from __future__ import annotations

import time
import warnings
from typing import TYPE_CHECKING

import torch
from stable_baselines3 import PPO
from stable_baselines3.common.callbacks import BaseCallback, ProgressBarCallback
from stable_baselines3.common.utils import LinearSchedule
from tqdm import TqdmExperimentalWarning

from agents.controllers.learned import Learned
from agents.evaluation.episodes import VALIDATION_SEED, evaluate
from agents.training.archive import policy_of
from agents.training.arrays import load_checkpoint, save_checkpoint
from agents.training.checkpoint import (
    parameters_of,
    restore,
    restore_parameters,
    state_of,
)
from agents.training.lanes import make_lanes
from agents.training.progress import Progress

if TYPE_CHECKING:
    from agents.training.arrays import Arrays
    from agents.training.config import TrainSettings
    from agents.training.lanes import TrainingLanes
    from agents.training.runs import Run
    from mm_gym import Scene


def train(settings: TrainSettings, run: Run) -> None:
    """Train until steps or time are used up, and write the best policy to the run's folder.

    An interrupted run continues from its last checkpoint; Ctrl-C writes one.

    Raises
    ------
    SceneError, CompileError
        If there is nothing to train on. No folder is made.
    RunError
        If the folder holds another run, or another process trains it.
    """
    scene = settings.load_scene()
    lanes = make_lanes(settings, scene)
    with run.locked():
        run.open(settings)
        if not run.finished:
            train_in_lanes(settings, scene, run, lanes)
    lanes.close()


def train_in_lanes(settings: TrainSettings, scene: Scene, run: Run, lanes: TrainingLanes) -> None:
    """Train, and write the best policy; the run's lock is held."""
    torch.set_num_threads(settings.threads)
    model = make_model(settings, run, lanes)
    progress = Progress()
    if run.checkpoint.exists():
        arrays = load_checkpoint(run.checkpoint)
        restore(model, arrays)
        progress = Progress.of(arrays)
    if model.num_timesteps < settings.steps and progress.seconds < settings.time_budget:
        learn(
            model, settings.steps - model.num_timesteps, Validation(settings, scene, run, progress)
        )
    progress.write_metrics(run)
    if progress.best:
        restore_parameters(model, progress.best)
    policy_of(model).save(run.policy)


def make_model(settings: TrainSettings, run: Run, lanes: TrainingLanes) -> PPO:
    """Return an untrained model."""
    ppo = settings.ppo
    return PPO(
        "MlpPolicy",
        lanes,
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
        except KeyboardInterrupt:
            validation.save()
            raise
        finally:
            # Left open, the garbage collector closes it, perhaps in the thread that draws it.
            if hasattr(bar, "pbar"):
                bar.pbar.close()


class Validation(BaseCallback):
    """Score the policy on the validation episodes and keep the best one.

    Also writes the checkpoint, and stops the training when the time is up.
    """

    def __init__(self, settings: TrainSettings, scene: Scene, run: Run, progress: Progress) -> None:
        super().__init__()
        self.settings, self.scene, self.run, self.progress = settings, scene, run, progress
        self.every = -(-settings.steps // settings.evaluations)
        self.began = time.perf_counter() - progress.seconds
        self.state: Arrays | None = None

    def _on_training_start(self) -> None:
        self.next = self.every * (self.num_timesteps // self.every + 1)

    def _on_rollout_start(self) -> None:
        validates = self.num_timesteps >= self.next
        if validates:
            self.next = self.every * (self.num_timesteps // self.every + 1)
            self._validate()
        self.progress.seconds = time.perf_counter() - self.began
        self.state = state_of(self.model) | self.progress.arrays()
        if validates:
            self.save()

    def _on_step(self) -> bool:
        return time.perf_counter() - self.began < self.settings.time_budget

    def _on_training_end(self) -> None:
        self._validate()
        self.state = state_of(self.model) | self.progress.arrays()
        self.save()

    def _validate(self) -> None:
        learned = Learned(policy_of(self.model))
        cost = evaluate(self.scene, learned, seed=VALIDATION_SEED, episodes=100).cost
        self.logger.record("validation/cost", cost)
        if cost < self.progress.least_cost:
            self.progress.best = parameters_of(self.model)
        self.progress.seconds = time.perf_counter() - self.began
        self.progress.add(self.num_timesteps, cost)

    def save(self) -> None:
        """Write the state at the start of this rollout, if any has begun."""
        if self.state is not None:
            save_checkpoint(self.run.checkpoint, self.state)
            self.progress.write_metrics(self.run)
