"""Training with an algorithm of Stable-Baselines3 or sb3-contrib, validated as it goes."""

from __future__ import annotations

import signal
import threading
import time
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import numpy as np
import torch
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.callbacks import BaseCallback, ProgressBarCallback
from stable_baselines3.common.on_policy_algorithm import OnPolicyAlgorithm
from stable_baselines3.common.vec_env import VecEnv, VecNormalize
from tqdm import TqdmExperimentalWarning

from agents.policies import policy_in
from agents.scoring import validation_cost
from agents.training.algorithms import algorithm_class, make_model, policy_of
from agents.training.arrays import Arrays, damage_named, load_checkpoint, save_checkpoint
from agents.training.checkpoint import restore, state_of
from agents.training.config import TrainSettings
from agents.training.lanes import make_lanes
from agents.training.own_scene import for_own_scene
from agents.training.parts import Parts, make_parts
from agents.training.progress import Ending, Progress, told_part
from agents.training.runs import Run, RunError
from agents.training.search import LOGS, VALIDATION
from mm_gym.files import write_bytes

Report = Callable[[int, float], None]

UNIT = "control step"  # what is counted
CHECKPOINT_PERIOD = 60.0  # longest time of training [s] that a kill undoes, but for a rollout


def train(
    settings: TrainSettings, run: Run, *, bar: bool = True, report: Report | None = None
) -> None:
    """Train until steps or time are used up, and write the best policy to the run's folder.

    An interrupted run continues from its last checkpoint, and Ctrl-C writes one. A finished run
    goes on where the settings differ in that they have more steps or time. Raise `SceneError` or
    `CompileError` if there is nothing to train on, `DependencyNotInstalled` if the algorithm needs
    a package that is missing. No folder is made. Raise `RunError` if the folder holds another run,
    another process trains it, or no validation had a finite cost; `OSError` if a file of the folder
    cannot be written.

    Parameters
    ----------
    bar
        Whether to draw a progress bar.
    report
        Called with the steps and the cost of each validation; what it raises ends the training.
    """
    algorithm_class(settings.algorithm)
    settings = for_own_scene(settings, run)
    parts = make_parts(settings)
    lanes = make_lanes(settings, parts)
    with run.locked():
        run.open(settings)
        if not run.finished:
            validation = Validation(settings, parts, run, report)
            _train_in_lanes(validation, _normalised(settings, lanes), bar=bar)
    lanes.close()


def _normalised(settings: TrainSettings, lanes: VecEnv) -> VecEnv:
    observations, rewards = settings.normalise_observations, settings.normalise_rewards
    if not (observations or rewards):
        return lanes
    return VecNormalize(
        lanes,
        norm_obs=observations,
        norm_reward=rewards,
        clip_obs=np.inf,  # clipping would keep it out of the policy's weights
        gamma=settings.chosen.discount,
    )


def _train_in_lanes(validation: Validation, lanes: VecEnv, *, bar: bool) -> None:
    """Train, and write the best policy; the run's lock is held."""
    settings, run = validation.settings, validation.run
    torch.set_num_threads(settings.threads)
    model = make_model(settings, run.folder / LOGS, lanes)
    if run.checkpoint.exists():
        arrays = load_checkpoint(run.checkpoint)
        with damage_named(run.checkpoint):
            restore(model, arrays)
            validation.progress = Progress.of(arrays)
            if validation.progress.best:
                policy_in(validation.progress.best["policy"].tobytes())
    progress = validation.progress
    if model.num_timesteps < settings.steps and progress.seconds < validation.budget:
        learn(model, settings.steps - model.num_timesteps, validation, bar=bar)
    progress.write_metrics(run)
    progress.require_best(run)
    parts, untrained = validation.parts, "an untrained network"
    Ending.of(
        progress,
        parts.scene,
        unit=UNIT,
        done=model.num_timesteps,
        total=settings.steps,
        time_budget=settings.time_budget if model.num_timesteps < settings.steps else None,
        began_as=untrained if parts.base is None else settings.base,
    ).write(run)
    write_bytes(run.policy, progress.best["policy"].tobytes())


def learn(model: BaseAlgorithm, steps: int, validation: Validation, *, bar: bool) -> None:
    """Train for so many more steps."""
    drawn = ProgressBarCallback()
    fresh = not validation.run.checkpoint.exists()  # which holds lanes that have been reset
    with warnings.catch_warnings(), _gentle_interrupts(model, validation):
        # Stable-Baselines3's progress bar is tqdm's rich one, which calls itself experimental.
        warnings.simplefilter("ignore", TqdmExperimentalWarning)
        try:
            model.learn(
                steps,
                callback=[validation, drawn] if bar else validation,
                reset_num_timesteps=fresh,
                tb_log_name=validation.settings.algorithm,
            )
        except KeyboardInterrupt:
            validation.save()
            done = told_part(model.num_timesteps, validation.settings.steps, UNIT)
            raise KeyboardInterrupt(done) from None
        except ValueError as error:
            if "of distribution" not in str(error):  # what torch says of a spread of 0 or nan
                raise
            done, name = model.num_timesteps, validation.settings.algorithm
            msg = f"diverged before {UNIT} {done}; a smaller {name}.learning_rate may help"
            raise RunError(msg) from error
        finally:
            # Left open, the garbage collector closes it, perhaps in the thread that draws it.
            if hasattr(drawn, "pbar"):
                drawn.pbar.close()


@contextmanager
def _gentle_interrupts(model: BaseAlgorithm, validation: Validation) -> Iterator[None]:
    """Let a first Ctrl-C wait for the end of a step where copying the state takes long.

    With a replay buffer no copy is kept of the state at the rollout's start.
    """
    own = threading.current_thread() is threading.main_thread()
    if isinstance(model, OnPolicyAlgorithm) or not own:
        yield
        return

    def note(*_: object) -> None:
        validation.interrupted = True
        signal.signal(signal.SIGINT, before)

    before = signal.signal(signal.SIGINT, note)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


class Validation(BaseCallback):
    """Score the policy on the validation episodes and keep the best one.

    Also writes the checkpoint, and stops the training when the time is up.
    """

    def __init__(
        self, settings: TrainSettings, parts: Parts, run: Run, report: Report | None = None
    ) -> None:
        super().__init__()
        self.settings, self.parts, self.run, self.report = settings, parts, run, report
        self.progress = Progress()
        self.every = -(-settings.steps // settings.evaluations)
        self.budget = np.inf if settings.time_budget is None else settings.time_budget
        self.state: Arrays | None = None
        self.interrupted = self.out_of_time = False

    def _on_training_start(self) -> None:
        self.saved = time.perf_counter()
        self.began = self.saved - self.progress.seconds
        self.next = self.every * (self.num_timesteps // self.every + 1)
        if not len(self.progress.rows):
            self._validate()

    def _on_rollout_start(self) -> None:
        validates = self.num_timesteps >= self.next
        if validates:
            self.next = self.every * (self.num_timesteps // self.every + 1)
            self._validate()
        now = time.perf_counter()
        self.progress.seconds = now - self.began
        self.out_of_time = self.progress.seconds >= self.budget
        late = now - self.saved >= CHECKPOINT_PERIOD
        saves = validates or late or self.interrupted
        if saves or self.out_of_time or isinstance(self.model, OnPolicyAlgorithm):
            self.state = state_of(self.model) | self.progress.arrays()
        if self.interrupted:
            raise KeyboardInterrupt
        if saves:
            self.save()

    def _on_step(self) -> bool:
        return not self.out_of_time

    def _on_training_end(self) -> None:
        self._validate()
        if self.state is None or not self.out_of_time:
            self.state = state_of(self.model)
        self.state |= self.progress.arrays()
        self.save()

    def _validate(self) -> None:
        policy = policy_of(self.model)
        agent = self.parts.controller(policy)
        cost = validation_cost(self.parts.scene, agent)
        self.logger.record(VALIDATION, cost)
        if cost < self.progress.least_cost:
            self.progress.best = {"policy": np.frombuffer(policy.to_bytes(), np.uint8)}
        self.progress.seconds = time.perf_counter() - self.began
        self.progress.add(self.num_timesteps, cost)
        if self.report is not None and self.num_timesteps:
            self.report(self.num_timesteps, cost)

    def save(self) -> None:
        """Write the state at the start of this rollout, if any has begun."""
        if self.state is not None:
            save_checkpoint(self.run.checkpoint, self.state)
            self.progress.write_metrics(self.run)
        self.saved = time.perf_counter()
