"""Sizes of what a network reads and does on a scene, as they are under its start."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from agents.control.controller import Acted, Controller, Info, Memory, Observation
from agents.controllers.learned import Learned, observed
from agents.rollout import Rollout
from agents.training.start import Start
from mm_gym import ActionError, MovingMassVectorEnv, Scene
from mm_gym.arrays import Array

LANES, SEED = 32, 5_000_000
"""Episodes in which sizes are measured, apart from those of any evaluation."""

LEAST = 0.05
"""Least size of an action: a start that hardly acts, as no control, is changed by this much."""


@dataclass(frozen=True, eq=False)
class Scales:
    """Root mean squares, or 1 throughout where a scene states them well."""

    inputs: Array  # (n + m + r,) of observation, linear memory and correlation units
    outputs: Array  # (k,) of the actions
    updates: Array  # (m,) of the change of each state of the linear memory in a step

    @classmethod
    def stated(cls, start: Start) -> Scales:
        """Return those of a scene whose own scales are right."""
        k, count = start.direct.shape
        return cls(np.ones(count - 1), np.ones(k), np.ones(len(start.keep)))

    @classmethod
    def measured(cls, scene: Scene, start: Start) -> Scales:
        """Return those under a start, in episodes of the scene."""
        watched = _Watched(start)
        env = MovingMassVectorEnv(scene, LANES, autoreset_mode="Disabled", info="none")
        try:
            for _ in Rollout(env, watched, seed=SEED):
                pass
        except ActionError:  # a start that is not stable
            return cls.stated(start)
        sums = watched.squares, watched.acted, watched.changed
        inputs, outputs, updates = (np.sqrt(total / watched.steps) for total in sums)
        units = np.ones(len(start.units))  # are of order one
        return cls(
            _usable(np.concatenate([inputs, units])), np.clip(outputs, LEAST, 1.0), _usable(updates)
        )

    @classmethod
    def around(cls, scene: Scene, base: Controller, start: Start) -> Scales:
        """Return those of what is added to a base, in episodes under it alone."""
        env = MovingMassVectorEnv(scene, LANES, autoreset_mode="Disabled")
        squares = [
            np.mean(observed(step.observation, step.action) ** 2, axis=0)
            for step in Rollout(env, base, seed=SEED)
        ]
        sizes, units = np.sqrt(np.mean(squares, axis=0)), np.ones(len(start.units))
        acted = np.clip(sizes[-len(start.direct) :], LEAST, 1.0)
        return cls(_usable(np.concatenate([sizes, units])), acted, np.ones(0))


def _usable(sizes: Array) -> Array:
    return np.where(np.isfinite(sizes) & (sizes > 0.0), sizes, 1.0)


def size_of_actions(scene: Scene, controller: Controller) -> float:
    """Return the root mean square of a controller's actions in episodes of a scene, at least 0."""
    env = MovingMassVectorEnv(scene, LANES, autoreset_mode="Disabled")
    squares = [np.mean(step.action**2) for step in Rollout(env, controller, seed=SEED)]
    return float(np.sqrt(np.mean(squares)))


class _Watched(Learned):
    """A start's policy; it sums the squares of what it reads, remembers and does."""

    def __init__(self, start: Start) -> None:
        super().__init__(start.policy())
        self.states = len(start.keep)
        self.squares: Array = np.zeros(start.pairs.shape[2])
        self.acted: Array = np.zeros(len(start.direct))
        self.changed: Array = np.zeros(self.states)
        self.steps = 0

    def propose(self, memory: Memory, observation: Observation, info: Info) -> Acted:
        action, after = super().propose(memory, observation, info)
        before, now = (one["policy"][:, : self.states] for one in (memory, after))
        read = np.hstack([observation, now])
        self.changed += np.mean((now - before) ** 2, axis=0)
        self.squares += np.mean(read**2, axis=0)
        self.acted += np.mean(action**2, axis=0)
        self.steps += 1
        return action, after
